// Programs of a person: one runs, the worker of the next one waits, and what a hostile one sends is limited.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";

/** @type {StandIn[]} */
const workers = [];

class StandIn {
  /** @type {any[]} */
  posted = [];
  isTerminated = false;
  /** @type {any} */
  onmessage = null;
  /** @type {any} */
  onerror = null;
  /** @param {URL} url */
  constructor(url) {
    this.url = String(url);
    workers.push(this);
  }
  /** @param {any} message */
  postMessage(message) {
    this.posted.push(message);
  }
  terminate() {
    this.isTerminated = true;
  }
}

const browser = /** @type {any} */ (globalThis);
browser.Worker = StandIn;
browser.window = new EventTarget();
browser.document = Object.assign(new EventTarget(), { hidden: false, documentElement: { dataset: {} } });
browser.WebSocket ??= { OPEN: 1, CLOSED: 3 };
const { WorkerLine, stopPorts } = await import("../../../servolink/studio/web/link/worker-line.js");
const { Programs } = await import("../../../servolink/studio/web/link/programs.js");
const code = await import("../../../servolink/studio/web/state/code.js");

new WorkerLine();
await Promise.resolve();
const studio = workers[0];
/** @type {any[]} */
let heard;
/** @type {InstanceType<typeof Programs>} */
let programs;
const last = () => /** @type {StandIn} */ (workers.at(-1));
/** @param {StandIn} worker @param {any} data */
const say = (worker, ...data) => worker.onmessage?.({ data });
const told = () => studio.posted.filter(([kind]) => kind.startsWith("program.")).map(([kind]) => kind);

beforeEach(() => {
  heard = [];
  studio.posted = [];
  programs = new Programs({
    onReady: (isReady) => heard.push(isReady),
    onOutput: (text) => heard.push(text),
    onEnd: (end, failure) => heard.push([end, failure?.line]),
  });
  programs.prepare();
  say(last(), "ready", "");
});

test("a program runs in the worker that waited, and the next worker starts at once", () => {
  const worker = last();
  programs.run("print(1)");
  assert.deepEqual(worker.posted, ["print(1)"]);
  assert.notEqual(last(), worker);
  say(worker, "output", "1\n");
  say(last(), "ready", "");
  say(worker, "ended", "");
  assert.deepEqual(heard, [true, false, "1\n", true, ["done", undefined]]);
  assert.ok(worker.isTerminated);
  assert.deepEqual(told(), ["program.open", "program.end"]);
});

test("nothing runs before a worker is ready, nor twice", () => {
  programs.run("first");
  programs.run("second");
  assert.deepEqual(last().posted, []);
  assert.deepEqual(told(), ["program.open", "program.end"]);
});

test("Stop ends the worker and tells the hub", () => {
  const worker = last();
  programs.run("while True: pass");
  programs.stop();
  programs.stop();
  assert.ok(worker.isTerminated);
  assert.deepEqual(heard.at(-1), ["stopped", undefined]);
  assert.deepEqual(told(), ["program.open", "program.end"]);
});

test("an error comes with its line, and one of the worker itself without", () => {
  const worker = last();
  programs.run("x");
  say(worker, "ended", JSON.stringify({ kind: "NameError", line: 3, message: "", trace: "" }));
  assert.deepEqual(heard.at(-1), ["failed", 3]);
  say(last(), "ready", "");
  const other = last();
  programs.run("x");
  other.onerror({ message: "out of memory" });
  assert.deepEqual(heard.at(-1), ["broken", 0]);
});

test("a program that floods the page is ended", () => {
  const worker = last();
  programs.run("hostile");
  for (let count = 0; count < 1000; count++) say(worker, "output", "x");
  assert.deepEqual(heard.at(-1), ["flood", undefined]);
  assert.ok(heard.length < 110);
});

test("messages that a program makes up change nothing", () => {
  const worker = last();
  programs.run("hostile");
  heard = [];
  for (const data of [null, 7, "ended", ["ready", ""], ["program.end", 1], [{}, {}]]) worker.onmessage?.({ data });
  assert.deepEqual(heard, []);
  worker.onmessage({ data: ["ended", "{"] });
  assert.deepEqual(heard.at(-1)?.[0], "failed");
});

test("STOP ends the program of the screen Code, and a text runs only with Run", async () => {
  code.prepareProgram();
  const worker = last();
  say(worker, "ready", "");
  code.changeProgram("print(2)");
  assert.deepEqual(worker.posted, []);
  await code.runProgram(/** @type {any} */ ({ makeWay: async () => {} }));
  assert.deepEqual([worker.posted, code.course.value], [["print(2)"], "running"]);
  stopPorts();
  assert.deepEqual([worker.isTerminated, code.course.value], [true, "stopped"]);
});

test("a program does not begin after a STOP that came while the robot was made ready", async () => {
  code.prepareProgram();
  const worker = last();
  say(worker, "ready", "");
  await code.runProgram(/** @type {any} */ ({ makeWay: async () => stopPorts() }));
  assert.deepEqual(worker.posted, []);
});
