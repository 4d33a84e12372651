import assert from "node:assert/strict";
import { beforeEach, mock, test } from "node:test";
import { sockets, turns } from "./page.mjs";

const { Link, LinkLost, RequestError } = await import("../../../servolink/studio/web/link/link.js");

beforeEach(() => (sockets.length = 0));

/** A link whose first connection is open. */
function connected() {
  const link = new Link(() => new WebSocket("ws://here/ws"), "token", "a page");
  link.open();
  sockets[0].welcome();
  return { link, socket: sockets[0] };
}

test("the first message names the page, and the first answer is the welcome", () => {
  const states = [];
  const link = new Link(() => new WebSocket("ws://here/ws"), "token", "a page");
  link.onState = (state) => states.push(state);
  link.onWelcome = (welcome) => states.push(welcome.session);
  link.open();
  sockets[0].welcome("mine");
  assert.deepEqual(sockets[0].sent, [{ token: "token", who: "a page" }]);
  assert.deepEqual(states, ["open", "mine"]);
});

test("results belong to their requests, in whatever order they come", async () => {
  const { link, socket } = connected();
  const [first, second] = [link.call("info"), link.call("battery")];
  const [one, two] = socket.sent.slice(1).map((message) => message.id);
  socket.hear({ id: two, result: "second" });
  socket.hear({ id: one, result: "first" });
  assert.deepEqual(await Promise.all([first, second]), ["first", "second"]);
});

test("an error has its kind and remedy", async () => {
  const { link, socket } = connected();
  const asked = link.call("move");
  const error = {
    code: 202,
    message: "too far",
    data: { kind: "MotionRefused", remedy: "stay within the limits" },
  };
  socket.hear({ id: socket.sent[1].id, error });
  await assert.rejects(asked, (found) => {
    assert.ok(found instanceof RequestError);
    assert.deepEqual([found.message, found.kind, found.remedy], ["too far", "MotionRefused", "stay within the limits"]);
    return true;
  });
});

test("a stop is acknowledged once its listener has heard it, and on opening those before", () => {
  const link = new Link(() => new WebSocket("ws://here/ws"), "token", "a page");
  link.open();
  sockets[0].welcome("mine", "rex", 7);
  assert.deepEqual(sockets[0].sent[1], {
    jsonrpc: "2.0",
    method: "stop.heard",
    params: { number: 7 },
  });
  link.on("stopped", () => link.tell("dropped"));
  sockets[0].hear({
    method: "stopped",
    params: { by: null, reason: "", stalled: null, number: 8 },
  });
  assert.deepEqual(
    sockets[0].sent.slice(2).map(({ method, params }) => [method, params]),
    [
      ["dropped", {}],
      ["stop.heard", { number: 8 }],
    ],
  );
});

test("a hub of an earlier version, whose stops have no number, gets no acknowledgement", () => {
  const { socket } = connected();
  socket.hear({ method: "stopped", params: { by: null } });
  assert.equal(socket.sent.length, 1);
});

test("progress and notifications reach those who want them, and nobody else", async () => {
  const { link, socket } = connected();
  const heard = [];
  link.on("servos", (params) => heard.push(params.number));
  const asked = link.call("project.apply", {}, (progress) => heard.push(progress.done));
  const { id } = socket.sent[1];
  socket.hear({ method: "progress", params: { id, done: 3 } });
  socket.hear({ method: "progress", params: { id: id + 1, done: 4 } });
  socket.hear({ method: "servos", params: { number: 7 } });
  socket.hear({ method: "unknown", params: {} });
  socket.hear({ id: id + 1, result: "of nobody" });
  socket.hear({ id, result: "done" });
  assert.equal(await asked, "done");
  assert.deepEqual(heard, [3, 7]);
});

test("a lost connection fails what was asked, and nothing is sent twice", async () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const { link, socket } = connected();
  const asked = link.call("move", { targets: { 1: 30 } });
  socket.lose();
  await assert.rejects(asked, LinkLost);
  await assert.rejects(link.call("move"), LinkLost);
  assert.equal(link.tell("lease.beat"), false);
  mock.timers.tick(250);
  sockets[1].welcome();
  await turns();
  assert.deepEqual(sockets[1].sent, [{ token: "token", who: "a page" }]);
  mock.timers.reset();
});

test("a studio leaves a board that is not shared any more with the next connection, which is tried at once", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const { link, socket } = connected();
  socket.lose(4404);
  link.leave();
  assert.equal(sockets.length, 2);
  sockets[1].welcome();
  assert.equal(sockets[1].sent[0].leaves, true);
  mock.timers.tick(10_000);
  assert.equal(sockets.length, 2); // the attempt that waited was given up
  sockets[1].lose(4410); // to another board, without a pause
  sockets[2].welcome();
  assert.equal(sockets[2].sent[0].leaves, undefined);
  mock.timers.reset();
});

test("pauses between attempts double up to four seconds, and begin anew after a welcome", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  connected();
  for (const [attempt, pause] of [250, 500, 1000, 2000, 4000, 4000].entries()) {
    sockets[attempt].lose();
    mock.timers.tick(pause - 1);
    assert.equal(sockets.length, attempt + 1);
    mock.timers.tick(1);
    assert.equal(sockets.length, attempt + 2);
  }
  sockets.at(-1).welcome();
  sockets.at(-1).lose();
  const before = sockets.length;
  mock.timers.tick(250);
  assert.equal(sockets.length, before + 1);
  mock.timers.reset();
});

test("a refused token ends the attempts", () => {
  mock.timers.enable({ apis: ["setTimeout"] });
  const states = [];
  const { link, socket } = connected();
  link.onState = (state) => states.push(state);
  socket.lose(4401);
  mock.timers.tick(60_000);
  assert.deepEqual(states, ["refused"]);
  assert.equal(sockets.length, 1);
  mock.timers.reset();
});

test("nothing is sent before the studio has named the board, and nothing at all to another board", async () => {
  const { link, socket } = connected();
  const moves = [];
  link.onMoved = (...names) => moves.push(names);
  socket.lose(4410);
  const next = sockets[1];
  next.readyState = 1;
  assert.equal(link.tell("lease.beat"), false);
  next.welcome("mine", "arm");
  assert.deepEqual(moves, [["rex", "arm", "virtual://"]]);
  await assert.rejects(link.call("studio.blocks.save"), LinkLost);
  assert.deepEqual(next.sent, [{ token: "token", who: "a page" }]);
});
