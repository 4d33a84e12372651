// A line to a studio in a worker behaves as the WebSocket for which the page was written.

import assert from "node:assert/strict";
import { afterEach, beforeEach, test } from "node:test";

/** @type {StandIn[]} */
const workers = [];

class StandIn {
  /** @type {[string, number, string][]} */
  posted = [];
  isTerminated = false;
  /** @type {(event: { data: [string, number, string] }) => void} */
  onmessage = () => {};
  /** @type {(event: { message: string }) => void} */
  onerror = () => {};
  constructor() {
    workers.push(this);
  }
  /** @param {[string, number, string]} message */
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
/** Frames that the serial port of this browser was given. @type {string[]} */
let written = [];
const serialPort = {
  getInfo: () => ({ usbVendorId: 0x1a86, usbProductId: 0x7523 }),
  open: async () => {
    serialPort.readable = new ReadableStream();
    serialPort.writable = new WritableStream({ write: (data) => void written.push(String.fromCharCode(...data)) });
  },
  close: async () => {},
  setSignals: async () => {},
  /** @type {any} */
  readable: null,
  /** @type {any} */
  writable: null,
};
const serial = Object.assign(new EventTarget(), { getPorts: async () => [serialPort] });
Object.defineProperty(globalThis, "navigator", {
  configurable: true,
  value: {
    serial,
    locks: { request: (/** @type {any} */ _name, /** @type {any} */ _options, /** @type {any} */ use) => use({}) },
  },
});
/** @type {any} */ (globalThis).WebSocket ??= { OPEN: 1, CLOSED: 3 };
const { stopPorts, watchPorts, WorkerLine } = await import("../../../servolink/studio/web/link/worker-line.js");
const { failure, loading } = await import("../../../servolink/studio/web/state/loading.js");

/** @type {InstanceType<typeof WorkerLine>} */
let line;
/** @type {unknown[]} */
let heard;

beforeEach(async () => {
  heard = [];
  line = new WorkerLine();
  line.onopen = () => line.send("hello");
  line.onmessage = ({ data }) => heard.push(data);
  line.onclose = ({ code }) => heard.push(code);
  await Promise.resolve();
});
afterEach(() => line.close());

const worker = () => /** @type {StandIn} */ (workers.at(-1));
/** @param {string} kind @param {string} text */
const say = (kind, text, number = line._number) => worker().onmessage({ data: [kind, number, text] });

test("the first text opens a line, further ones are messages, and a worker serves all lines", () => {
  line.send("move");
  assert.deepEqual(
    worker()
      .posted.filter(([kind]) => kind !== "port.list")
      .slice(-2),
    [
      ["open", line._number, "hello"],
      ["message", line._number, "move"],
    ],
  );
  assert.equal(workers.length, 1);
});

test("messages reach their own line, and none after its end", () => {
  say("message", "one");
  say("message", "other", line._number + 1);
  say("close", JSON.stringify({ code: 4410, reason: "" }));
  say("message", "late");
  assert.deepEqual(heard, ["one", 4410]);
  assert.equal(line.readyState, WebSocket.CLOSED);
});

test("what has been loaded is told", () => {
  say("progress", JSON.stringify({ loaded: 3, total: 10 }), 0);
  assert.deepEqual(loading.value, { loaded: 3, total: 10 });
});

test("a worker that fails closes every line, says why, and is replaced", async () => {
  const first = worker();
  first.onerror({ message: "no memory" });
  assert.deepEqual(heard, [1011]);
  assert.equal(failure.value, "no memory");
  assert.ok(first.isTerminated);
  line = new WorkerLine();
  assert.notEqual(worker(), first);
});

const turn = () => new Promise((resolve) => setTimeout(resolve));
const told = () => worker().posted.filter(([kind]) => kind === "port.stopped").length;

async function connected() {
  say("port.open", JSON.stringify({ url: "webserial://1a86:7523" }), 7);
  await turn();
  say("port.stop", "STOP", 7);
  written = [];
}

watchPorts();
for (const [why, happen] of /** @type {[string, () => void][]} */ ([
  ["STOP", stopPorts],
  [
    "a page that is hidden",
    () => {
      browser.document.hidden = true;
      browser.document.dispatchEvent(new Event("visibilitychange"));
      browser.document.hidden = false;
    },
  ],
  ["a page that is frozen", () => browser.document.dispatchEvent(new Event("freeze"))],
  ["a page that is left", () => browser.window.dispatchEvent(new Event("pagehide"))],
])) {
  test(`${why} stops all servos at once, and tells the worker`, async () => {
    await connected();
    const before = told();
    happen();
    assert.deepEqual([written, told()], [["STOP"], before + 1]);
    say("port.close", "", 7);
    await turn();
  });
}

test("a page that is shown again stops nothing", async () => {
  await connected();
  browser.document.dispatchEvent(new Event("visibilitychange"));
  assert.deepEqual(written, []);
  say("port.close", "", 7);
  await turn();
});

test("a worker that has ended is followed by a stop at once", async () => {
  await connected();
  worker().onerror({ message: "no memory" });
  assert.deepEqual(written, ["STOP"]);
});

test("the worker is told the ports that come and go, by the names of their makers", async () => {
  serial.dispatchEvent(new Event("connect"));
  await turn();
  assert.deepEqual(worker().posted.at(-1), [
    "port.list",
    0,
    JSON.stringify([{ url: "webserial://1a86:7523", product: "CH340" }]),
  ]);
});
