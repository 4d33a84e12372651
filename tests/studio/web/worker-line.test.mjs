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

/** @type {any} */ (globalThis).Worker = StandIn;
/** @type {any} */ (globalThis).WebSocket ??= { OPEN: 1, CLOSED: 3 };
const { WorkerLine } = await import("../../../servolink/studio/web/link/worker-line.js");
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
