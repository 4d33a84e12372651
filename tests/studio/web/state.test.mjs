import assert from "node:assert/strict";
import { test } from "node:test";
import { FakeLink } from "./page.mjs";

const web = "../../../servolink/studio/web/";
const { UndoList } = await import(`${web}state/undo.js`);
const { History, LENGTH } = await import(`${web}state/history.js`);
const { stoppedCount, isAllStopped } = await import(`${web}state/stopped.js`);
const { readAt, servos } = await import(`${web}state/robot.js`);

test("a drag is one step to undo, and the next drag another", () => {
  const steps = new UndoList();
  steps.add(["turn"], 0, 1, "servo 1");
  steps.add(["turn"], 1, 2, "servo 1");
  steps.settle();
  steps.add(["turn"], 2, 3, "servo 1");
  assert.deepEqual(steps.undo(), {
    label: ["turn"],
    merge: "servo 1",
    before: 2,
    after: 3,
  });
  assert.equal(steps.undo()?.before, 0);
  assert.equal(steps.undo(), null);
  assert.equal(steps.redo()?.after, 2);
  steps.add(["other"], 2, 9, "");
  assert.equal(steps.redo(), null);
});

test("at most 300 steps are kept", () => {
  const steps = new UndoList();
  for (let step = 0; step < 400; step++) steps.add(["step"], step, step + 1, "");
  let count = 0;
  while (steps.undo() !== null) count++;
  assert.equal(count, 300);
});

test("rings keep the last minute, and a servo that is missing leaves a gap", () => {
  const history = new History();
  const servo = (servo_id, angle) => ({
    servo_id,
    angle,
    current_raw: 1,
    temperature_raw: 2,
  });
  history.add(0, [servo(1, 10), servo(2, 20)]);
  history.add(1, [servo(1, 11)]);
  assert.deepEqual([...history.of(1).angle.slice(0, 2)], [10, 11]);
  assert.ok(Number.isNaN(history.of(2).angle[1]));
  const frozen = history.copy();
  for (let at = 2; at < LENGTH + 1; at++) history.add(at, [servo(1, at)]);
  assert.equal(history.of(1).angle[0], LENGTH);
  assert.equal(frozen.of(1).angle[0], 10);
});

test("values that cannot be true leave a gap in the rings of their servo only", () => {
  const history = new History();
  const values = { angle: 7, current_raw: 1, temperature_raw: 2 };
  history.add(0, [
    { servo_id: 1, ...values },
    { servo_id: 2, ...values, doubt: "not measured" },
  ]);
  for (const [quantity, value] of Object.entries(values)) {
    assert.equal(history.of(1)[quantity][0], value);
    assert.ok(Number.isNaN(history.of(2)[quantity][0]));
  }
});

test("servos count as stopped only when they stay so", () => {
  const read = (at, states) => {
    readAt.value = at;
    servos.value = new Map(states.map(([is_start, is_hold], at) => [at, { servo_id: at, is_start, is_hold }]));
  };
  read(0, [[true, true], [false, true]]); // prettier-ignore
  assert.equal(stoppedCount.value, 0);
  read(500, [[false, true], [false, true]]); // prettier-ignore
  assert.equal(stoppedCount.value, 2);
  assert.ok(isAllStopped.value);
  read(600, [[true, true], [false, false]]); // prettier-ignore
  assert.equal(stoppedCount.value, 0);
});

test("a servo that turns slowly does not rest, and one that trembles does", async (context) => {
  const robot = await import(`${web}state/robot.js`);
  const link = new FakeLink();
  let now = 10_000;
  context.mock.method(performance, "now", () => now);
  robot.follow(link, () => {});
  const read = (angle) => {
    now += 100;
    link.hear("servos", {
      number: 1,
      seconds: now / 1000,
      servos: [{ servo_id: 1, angle, is_start: true, is_hold: true }],
    });
  };
  for (let angle = 0; angle < 20; angle += 0.25) read(Math.round(angle));
  assert.ok(!robot.isStill()); // 2.5 degrees in a second
  for (let count = 0; count < 40; count++) read(20 + (count % 2));
  assert.ok(robot.isStill());
});

test("two drafts with deeply nested macros are compared in a moment", async () => {
  const { isSameRun } = await import(`${web}state/twin.js`);
  const command = (id) => ({ type: "macro", macro_id: id, ratio_percent: 100, loop: 1, total_interval_ms: 0 });
  const macros = Array.from({ length: 31 }, (_, at) => ({
    macro_id: at + 1,
    macro_caption: "",
    commands: at < 30 ? [command(at + 2), command(at + 2)] : [],
  }));
  const one = { actions: [], macros };
  assert.equal(isSameRun(one, { ...one }, "macro", 1), true);
  const other = { ...one, macros: [...macros.slice(0, 30), { ...macros[30] }] };
  assert.equal(isSameRun(one, other, "macro", 1), false);
});
