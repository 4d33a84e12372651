import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { afterEach, beforeEach, mock, test } from "node:test";
import { document, FakeLink, tick, turns, window } from "./page.mjs";

const web = "../../../servolink/studio/web/";
const { Motion, pace, refusal, running, targets } = await import(`${web}state/motion.js`);
const { MotionState, TRANSITIONS } = await import(`${web}state/motion-state.js`);
const { Nudges } = await import(`${web}state/nudging.js`);
const { lease, linkState, servos, welcome } = await import(`${web}state/robot.js`);
const { RequestError } = await import(`${web}link/link.js`);
const { tintOf } = await import(`${web}screens/live/stage-card.js`);

let link, motion;

beforeEach(() => {
  mock.timers.enable({ apis: ["setTimeout"] });
  link = new FakeLink();
  welcome.value = { session: "mine", role: "edit" };
  linkState.value = "open";
  lease.value = null;
  pace.value = 100;
  servos.value = new Map([1, 2].map((id) => [id, { servo_id: id, angle: 0, is_start: true, is_hold: true }]));
  motion = new Motion(link);
});

afterEach(() => {
  motion.leave();
  mock.timers.reset();
});

const mine = { session: "mine", who: "a page", since: 0, dead_man: 0.35 };

/** Hold, as a person does who presses a control and gets the lease. */
async function hold() {
  const held = motion.begin();
  await turns();
  lease.value = mine;
  link.taken("lease.take").resolve({});
  assert.equal(await held, true);
}

test("nothing is sent before the hub has given the lease", async () => {
  motion.towards({ 1: 30 });
  await turns();
  assert.deepEqual(link.asked, []);
});

test("a movement takes the way at the chosen pace", async () => {
  await hold();
  motion.towards({ 1: 50 });
  await turns();
  assert.deepEqual(link.taken("move").params, {
    targets: { 1: 50 },
    duration: 0.5,
  });
});

test("while a movement is under way only the latest wish is kept", async () => {
  await hold();
  motion.towards({ 1: 10 });
  await turns();
  const first = link.taken("move");
  for (const angle of [20, 30, 40]) motion.towards({ 1: angle });
  await turns();
  assert.equal(link.taken("move"), null);
  first.resolve({ seconds: 0.1 });
  await turns();
  mock.timers.tick(1000);
  await turns();
  assert.deepEqual(link.taken("move").params.targets, { 1: 40 });
});

test("servos that still turn are stopped when the control is released, and nothing follows", async () => {
  await hold();
  motion.towards({ 1: 90 });
  await turns();
  motion.towards({ 1: 120 });
  motion.end();
  await turns();
  assert.deepEqual(link.taken("move.end").params, { servos: [1] });
  link.taken("move").resolve({ seconds: 1 });
  mock.timers.tick(1000);
  await turns();
  assert.equal(link.taken("move"), null);
  assert.deepEqual(targets.value, {});
});

test("a stop by another page drops what was not sent yet", async () => {
  await hold();
  motion.towards({ 1: 10 });
  await turns();
  motion.towards({ 1: 20 });
  link.listeners.get("stopped")({});
  link.taken("move").resolve({ seconds: 0.1 });
  mock.timers.tick(1000);
  await turns();
  assert.equal(link.taken("move"), null);
});

test("a lost lease ends the hold without a further request", async () => {
  await hold();
  lease.value = {
    session: "another",
    who: "another page",
    since: 0,
    dead_man: null,
  };
  motion.towards({ 1: 10 });
  await turns();
  assert.deepEqual(link.asked, []);
});

test("a refusal is shown, and ends what was moved", async () => {
  await hold();
  motion.towards({ 1: 10, 2: 10 });
  await turns();
  link.taken("move").reject(new RequestError({ code: 202, message: "beyond the limits" }));
  await turns();
  assert.equal(refusal.value, "beyond the limits");
  motion.towards({ 1: 20 });
  await turns();
  assert.equal(link.taken("move"), null);
});

test("beats go out while the page is visible and the lease is taken, and end with it", async () => {
  const beats = () => link.told.filter((method) => method === "lease.beat").length;
  tick();
  assert.equal(beats(), 0);
  await hold();
  tick();
  assert.equal(beats(), 2); // one with the lease itself
  document.hidden = true;
  tick();
  assert.equal(beats(), 2);
  document.hidden = false;
  motion.leave();
  tick();
  assert.equal(beats(), 2);
});

for (const [target, name] of [
  [window, "blur"],
  [window, "pagehide"],
]) {
  test(`the lease is given back on ${name}`, async () => {
    await hold();
    target.dispatchEvent(new Event(name));
    assert.ok(link.told.includes("lease.give"));
  });
}

test("a sequence plays step by step, and ends with the hold", async () => {
  await hold();
  const times = [];
  const part = (at, angle) => ({ at, duration: 0.2, targets: { 1: angle } });
  const played = motion.play([part(0, 10), part(0.5, 20)], 1, (time) => times.push(time));
  mock.timers.tick(0);
  await turns();
  const step = link.taken("move");
  assert.deepEqual(step.params, { targets: { 1: 10 }, duration: 0.2 });
  motion.end();
  step.resolve({ seconds: 0.2 });
  await turns();
  mock.timers.tick(1000);
  assert.equal(await played, false);
  assert.deepEqual(times, [0]);
});

/** Let the movement of a nudge be answered, and the time pass until the next step. Return the target of servo 1. */
async function step() {
  const { params, resolve } = link.taken("move");
  resolve({ seconds: 0 });
  await turns();
  for (const milliseconds of [400, 0, 0]) {
    mock.timers.tick(milliseconds);
    await turns();
  }
  return params.targets[1];
}

test("each press of a nudge is a step, and more follow only while it is held", async () => {
  const nudges = new Nudges(motion, 1);
  nudges.press(5);
  nudges.release();
  nudges.press(-1);
  nudges.release();
  await turns();
  lease.value = mine;
  link.taken("lease.take").resolve({});
  await turns();
  mock.timers.tick(0);
  await turns();
  assert.equal(await step(), 5);
  nudges.press(1);
  assert.equal(await step(), 4);
  assert.equal(await step(), 5);
  assert.equal(await step(), 6);
  nudges.release();
  assert.equal(await step(), 7); // had begun
  assert.equal(motion.isHeld, false);
});

test("a stop forgets the steps of a nudge, and another press begins anew", async () => {
  const nudges = new Nudges(motion, 1);
  nudges.press(5);
  nudges.release();
  await turns();
  link.listeners.get("stopped")({});
  nudges.press(1);
  nudges.release();
  lease.value = mine;
  for (let count = 0; count < 2; count++) {
    link.taken("lease.take").resolve({});
    await turns();
  }
  mock.timers.tick(0);
  await turns();
  assert.equal(await step(), 1);
  assert.equal(link.taken("move"), null);
  assert.equal(motion.isHeld, false);
});

test("a stored motion is stopped when the page is left", async () => {
  const begun = motion.run("macro", 3, 2);
  await turns();
  lease.value = mine;
  link.taken("lease.take").resolve({});
  await turns();
  link.taken("run").resolve({});
  assert.equal(await begun, true);
  assert.deepEqual(running.value, { type: "macro", id: 3 });
  motion.leave();
  await turns();
  assert.ok(link.taken("stop"));
  assert.equal(running.value, null);
});

/** Release the control while a servo turns. */
async function brake() {
  motion.towards({ 1: 90 });
  await turns();
  motion.end();
  await turns();
}

/** Bring about each state, with a request for the lease under way that any of them may see answered. */
const REACH = {
  idle: async () => {
    motion.begin();
    await turns();
    motion.end();
  },
  taking: async () => {
    motion.begin();
    await turns();
  },
  held: async () => {
    motion.begin();
    motion.begin();
    await turns();
    link.taken("lease.take").resolve({});
    await turns();
  },
  ending: async () => {
    motion.begin();
    await turns();
    await brake();
  },
  waiting: async () => {
    motion.begin();
    await turns();
    await brake();
    motion.begin();
  },
};

/** Let each event happen. */
const HAPPEN = {
  pressed: () => void motion.begin(),
  leased: () => link.taken("lease.take").resolve({}),
  released: () => motion.end(),
  braking: brake,
  braked: () => link.taken("move.end").resolve({}),
  dropped: () => link.listeners.get("stopped")({}),
};

for (const [state, events] of Object.entries(TRANSITIONS)) {
  for (const [event, next] of Object.entries(events)) {
    test(`a movement that is ${state} is ${next} after the event ${event}`, async () => {
      lease.value = mine;
      await REACH[state]();
      assert.equal(motion.state, state);
      await HAPPEN[event]();
      await turns();
      assert.equal(motion.state, next);
    });
  }
  for (const event of Object.keys(HAPPEN).filter((name) => !(name in events))) {
    test(`the event ${event} in the state ${state} is a defect`, () => {
      const path = { idle: [], taking: ["pressed"], held: ["pressed", "leased"], ending: ["pressed", "braking"] };
      const odd = new MotionState();
      for (const each of path[state] ?? [...path.ending, "pressed"]) odd.change(each);
      assert.equal(odd.now, state);
      assert.throws(() => odd.change(event), new RegExp(`internal error: the event ${event} in the state ${state}`));
      assert.equal(odd.now, state);
    });
  }
}

test("the page on the studio prints the states and their table", () => {
  const page = readFileSync(new URL("../../../docs/design/studio.md", import.meta.url), "utf8");
  const rows = (header) => page.split(`\n${header}\n`)[1].split("\n\n")[0].split("\n").slice(1);
  const words = (row) => [...row.matchAll(/`(\w+)`/g)].map(([, word]) => word);
  assert.deepEqual(rows("| state | control | what is under way |").flatMap(words), Object.keys(TRANSITIONS));
  assert.deepEqual(
    rows("| state | event | next state |").map(words),
    Object.entries(TRANSITIONS).flatMap(([state, events]) =>
      Object.entries(events).map(([event, next]) => [state, event, next]),
    ),
  );
});

test("a control that is held again waits until the servos have stopped", async () => {
  await hold();
  await brake();
  const held = motion.begin();
  await turns();
  assert.equal(link.taken("lease.take"), null);
  link.taken("move.end").resolve({});
  await turns();
  link.taken("lease.take").resolve({});
  assert.equal(await held, true);
});

test("of two requests that stop servos the last one ends the state", async () => {
  await hold();
  await brake();
  motion.begin();
  await brake();
  const [first, last] = [link.taken("move.end"), link.taken("move.end")];
  first.resolve({});
  await turns();
  assert.equal(motion.state, "ending");
  last.resolve({});
  await turns();
  assert.equal(motion.state, "idle");
});

test("the lease is given back only when the servos have stopped, and not if a control is held again", async () => {
  const gives = () => link.told.filter((method) => method === "lease.give").length;
  await hold();
  await brake();
  motion.leave();
  assert.equal(gives(), 0);
  link.taken("move.end").resolve({});
  await turns();
  assert.equal(gives(), 1);
  await hold();
  await brake();
  motion.leave();
  motion.begin();
  link.taken("move.end").resolve({});
  await turns();
  assert.equal(gives(), 1);
});

test("a lease that the hub refuses leaves nothing held", async () => {
  const held = motion.begin();
  await turns();
  link.taken("lease.take").reject(new RequestError({ code: 201, message: "another page moves the robot" }));
  assert.equal(await held, false);
  assert.equal(motion.state, "idle");
  assert.equal(refusal.value, "another page moves the robot");
});

test("servos that have arrived are not stopped", async () => {
  await hold();
  motion.towards({ 1: 30 });
  await turns();
  link.taken("move").resolve({ seconds: 0 });
  await turns();
  servos.value = new Map([[1, { servo_id: 1, angle: 29, is_start: true, is_hold: true }]]);
  motion.end();
  await turns();
  assert.equal(link.taken("move.end"), null);
  assert.equal(motion.state, "idle");
});

test("movements of a lost lease are not ended: another page moves the robot", async () => {
  await hold();
  motion.towards({ 1: 90 });
  await turns();
  lease.value = { ...mine, session: "another" };
  assert.equal(motion.state, "idle");
  motion.end();
  await turns();
  assert.equal(link.taken("move.end"), null);
});

test("the servo whose stall stopped the robot is marked until it is started, or another stop comes", () => {
  const marked = () => [1, 2].filter((id) => tintOf(servos.value.get(id)) !== null);
  link.listeners.get("stopped")({ by: null, reason: "servo 2 is stalled", stalled: 2 });
  assert.deepEqual(marked(), []);
  servos.value = new Map([1, 2].map((id) => [id, { servo_id: id, angle: 0, is_start: false, is_hold: true }]));
  assert.deepEqual(marked(), [2]);
  link.listeners.get("stopped")({ by: "a page" });
  assert.deepEqual(marked(), []);
});
