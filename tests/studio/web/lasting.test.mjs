// A page without a server sends short motions to a robot at its port, and asks before what lasts on the board.

import assert from "node:assert/strict";
import { afterEach, beforeEach, mock, test } from "node:test";
import { document, FakeLink, turns } from "./page.mjs";

document.documentElement = { dataset: { studio: "worker" } };
const web = "../../../servolink/studio/web/";
const { Motion, pace, targets } = await import(`${web}state/motion.js`);
const { beginLasting, shortened } = await import(`${web}state/lasting.js`);
const { lease, linkState, servos, welcome } = await import(`${web}state/robot.js`);
const { toasts } = await import(`${web}state/toasts.js`);

let link, motion;
const part = (at, duration, targets) => ({ at, duration, targets });

beforeEach(() => {
  mock.timers.enable({ apis: ["setTimeout"] });
  link = new FakeLink();
  welcome.value = { session: "mine", role: "edit", is_virtual: false };
  linkState.value = "open";
  lease.value = null;
  pace.value = 10;
  servos.value = new Map([1, 2].map((id) => [id, { servo_id: id, angle: 0, is_start: true, is_hold: true }]));
  motion = new Motion(link);
});
afterEach(() => {
  motion.leave();
  mock.timers.reset();
});

async function hold() {
  const held = motion.begin();
  await turns();
  lease.value = { session: "mine", who: "a page", since: 0, dead_man: 0.35 };
  link.taken("lease.take").resolve({});
  assert.equal(await held, true);
}

test("a long motion is cut into pieces of at most 2 s, none faster than the whole", () => {
  const pieces = shortened([part(0, 9, { 1: 90, 2: -31 })]);
  let at = 0,
    here = { 1: 0, 2: 0 };
  for (const piece of pieces) {
    assert.ok(piece.duration <= 2 && Math.abs(piece.at - at) < 1e-9);
    for (const id of [1, 2]) {
      const speed = Math.abs(piece.targets[id] - here[id]) / piece.duration;
      assert.ok(speed <= { 1: 90 / 9, 2: 31 / 9 }[id] + 1e-9, `${id}: ${speed}`);
    }
    at += piece.duration;
    here = piece.targets;
  }
  assert.deepEqual(here, { 1: 90, 2: -31 });
  assert.ok(at < 9.5, String(at));
});

test("pieces of movements at the same time come in the order of their times, the latest for each servo", () => {
  const pieces = shortened([part(0, 6, { 1: 60, 2: 60 }), part(3, 1, { 2: 0 })]);
  assert.deepEqual(
    pieces.map(({ at }) => at),
    pieces.map(({ at }) => at).sort((one, other) => one - other),
  );
  assert.ok(pieces.filter(({ at }) => at > 3).every(({ targets }) => !(2 in targets)));
  assert.deepEqual(pieces.at(-1).targets, { 1: 60 });
});

for (const [why, first] of [
  ["a virtual robot", { is_virtual: true }],
  ["no robot yet", null],
])
  test(`nothing is cut, and nothing asked, for ${why}`, () => {
    welcome.value = first && { session: "mine", role: "edit", ...first };
    const whole = [part(0, 9, { 1: 90 })];
    assert.equal(shortened(whole), whole);
    let count = 0;
    beginLasting(() => count++);
    assert.equal(count, 1);
  });

test("a control that is held goes on after 2 s, and no further after its release", async () => {
  await hold();
  motion.towards({ 1: 90 });
  await turns();
  for (const angle of [15, 30]) {
    const { params, resolve } = link.taken("move");
    assert.deepEqual(params, { targets: { 1: angle }, duration: 1.5 });
    assert.equal(targets.value[1], 90);
    resolve({ seconds: 1.5 });
    await turns();
    servos.value = new Map([[1, { servo_id: 1, angle, is_start: true, is_hold: true }]]);
    mock.timers.tick(1500);
    await turns();
    mock.timers.tick(50);
    await turns();
    pace.value = 10;
  }
  motion.end();
  link.taken("move")?.resolve({ seconds: 1.5 });
  await turns();
  mock.timers.tick(5000);
  await turns();
  assert.equal(link.taken("move"), null);
});

test("what lasts on the board begins after a yes, which counts for the visit", () => {
  let count = 0;
  const begin = () => count++;
  beginLasting(begin);
  assert.equal(count, 0);
  const [asked] = toasts.value.filter(({ name }) => name === "lasting");
  assert.match(asked.detail, /runs on when the browser is killed/);
  asked.action.run();
  assert.equal(count, 1);
  beginLasting(begin);
  assert.equal(count, 2);
});
