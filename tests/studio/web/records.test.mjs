// Records of a project and changes of them: records.js, edit-action.js, edit-macro.js and limits.js.

import assert from "node:assert/strict";
import { beforeEach, test } from "node:test";
import { projectForm } from "./page.mjs";

const state = "../../../servolink/studio/web/state/";
const records = await import(`${state}records.js`);
const actions = await import(`${state}edit-action.js`);
const macros = await import(`${state}edit-macro.js`);
const { capOf, slowness, within } = await import(`${state}limits.js`);
const { welcome } = await import(`${state}robot.js`);

let project;
beforeEach(() => (project = Object.freeze(projectForm())));

test("a new record gets the lowest free id, and replaces the record of its id", () => {
  assert.equal(records.freeId("actions", project), 3);
  const gap = { ...project, actions: project.actions.slice(1) };
  assert.equal(records.freeId("actions", gap), 1);
  const renamed = records.withRecord(project, "actions", { ...project.actions[0], action_caption: "high" });
  assert.deepEqual(
    renamed.actions.map((one) => one.action_caption),
    ["high", "down"],
  );
  const added = records.withRecord(project, "actions", { action_id: 9, action_caption: "", steps: [] });
  assert.deepEqual(
    added.actions.map((one) => one.action_id),
    [1, 2, 9],
  );
  assert.equal(project.actions.length, 2);
});

test("with an action the commands go that run it, and with a macro its buttons too", () => {
  const without = records.withoutAction(project, 1);
  assert.deepEqual(
    without.macros.map((one) => one.commands.length),
    [1, 2],
  );
  assert.equal(without.macros[1], project.macros[1]);
  const rest = records.withoutMacro(project, 1);
  assert.deepEqual(
    rest.macros.map((one) => [one.macro_id, one.commands.map((command) => command.type)]),
    [[2, ["delay"]]],
  );
  const [button] = rest.joystick_tables[0].buttons;
  assert.deepEqual([button.button_press_macro, button.button_long_press_macro], [0, 2]);
});

test("callers of a record are the macros that run it themselves", () => {
  const ids = (type, id) => records.callersOf(project, type, id).map((one) => one.macro_id);
  assert.deepEqual(ids("action", 1), [1]);
  assert.deepEqual(ids("macro", 1), [2]);
  assert.deepEqual(ids("macro", 2), []);
});

test("an action takes as long as its longest step, and the last step of a servo counts", () => {
  const [up] = project.actions;
  assert.equal(records.secondsOf(up), 1);
  assert.equal(records.secondsOf({ ...up, steps: [] }), 0);
  const twice = { ...up, steps: [...up.steps, { servo_id: 1, degree: 5, interval_ms: 10 }] };
  assert.deepEqual(records.poseOf(twice), { 1: 5, 2: -30 });
});

test("an edit of another page is applied record by record, also to the numbers of the project", () => {
  const record = { ...project.actions[1], action_caption: "low" };
  const edited = records.withEdit(project, { kind: "actions", id: 2, record });
  assert.equal(records.recordOf(edited, { kind: "actions", id: 2 }), record);
  const removed = records.withEdit(edited, { kind: "actions", id: 1, record: null });
  assert.equal(records.recordOf(removed, { kind: "actions", id: 1 }), null);
  assert.deepEqual(removed.actions, [record]);
  const back = records.withEdit(removed, { kind: "actions", id: 1, record: project.actions[0] });
  assert.deepEqual(
    back.actions.map((one) => one.action_id),
    [1, 2],
  );
  const active = { kind: "active_joystick_table", id: 0, record: null };
  assert.equal(records.recordOf(records.withEdit(project, active), active), null);
});

test("a servo that joins an action gets the time of the slowest one, in the order of the servos", () => {
  const [, down] = project.actions;
  const joined = actions.withDegrees(down, { 1: 10, 3: 40, 2: 5 });
  assert.deepEqual(
    joined.steps.map((step) => [step.servo_id, step.degree, step.interval_ms]),
    [
      [1, 10, 500],
      [2, 5, 500],
      [3, 40, 500],
    ],
  );
  const first = actions.withDegrees({ ...down, steps: [] }, { 4: 1 });
  assert.deepEqual(first.steps, [{ servo_id: 4, degree: 1, interval_ms: 500 }]);
  assert.deepEqual(actions.withoutServo(joined, 2).steps.length, 2);
});

test("times are multiples of 10 ms within what the board stores", () => {
  const [up] = project.actions;
  const times = (action) => action.steps.map((step) => step.interval_ms);
  assert.deepEqual(times(actions.withTime(up, 123.4, 2)), [500, 120]);
  assert.deepEqual(times(actions.withTime(up, -5)), [0, 0]);
  assert.deepEqual(times(actions.withTime(up, 1e9)), [records.LONGEST, records.LONGEST]);
});

test("steps that are too fast get as much time as they need, others keep theirs", () => {
  const [up] = project.actions;
  const start = { 1: 0, 2: -30 };
  assert.deepEqual(
    [...actions.speedsOf(up, start)],
    [
      [1, 180],
      [2, 0],
    ],
  );
  const capOf100 = () => 100;
  assert.deepEqual(actions.tooFast(up, start, capOf100), [[1, 180]]);
  const slower = actions.withEnoughTime(up, start, capOf100);
  assert.deepEqual(
    slower.steps.map((step) => step.interval_ms),
    [900, 1000],
  );
  assert.deepEqual(actions.tooFast(slower, start, capOf100), []);
  const jump = actions.withTime(up, 0);
  assert.deepEqual(actions.tooFast(jump, start, capOf100), [[1, Infinity]]);
  assert.equal(actions.speedsOf(up, {}).size, 0);
});

test("commands are put in, changed, moved and taken out by their index", () => {
  const [wave] = project.macros;
  const ids = (macro) => macro.commands.map((command) => records.targetOf(command) || command.delay_ms);
  const pause = macros.commandOf("delay", 300);
  const longer = macros.withCommandAt(wave, 1, pause);
  assert.deepEqual(ids(longer), [1, 300, 2]);
  assert.deepEqual(ids(macros.withMoved(longer, 0, 2)), [300, 2, 1]);
  assert.deepEqual(ids(macros.withMoved(longer, 2, 0)), [2, 1, 300]);
  assert.deepEqual(ids(macros.withoutCommandAt(longer, 0)), [300, 2]);
  assert.equal(macros.withCommand(wave, 0, { loop: 4 }).commands[0].loop, 4);
  assert.deepEqual(ids(wave), [1, 2]);
});

test("a macro may call only macros that do not lead back to it", () => {
  const [wave, twice] = project.macros;
  const ids = (macro) => macros.callable(project, macro).map((one) => one.macro_id);
  assert.deepEqual(ids(twice), [1]);
  assert.deepEqual(ids(wave), []);
});

test("limits are those of the profile, and usual ones without a profile", () => {
  welcome.value = { profile: null };
  assert.equal(capOf(1), 240);
  assert.equal(slowness.value, 1);
  assert.equal(within(1, 200.4), 180);
  const limits = { speed_cap: 90, speed_caps: { 2: 30 }, angles: { 1: [-20, 45] } };
  welcome.value = { profile: { limits, settings: { interval_unit: 0.02 } } };
  assert.deepEqual([capOf(1), capOf(2), slowness.value], [90, 30, 2]);
  assert.deepEqual([within(1, 60), within(1, -60), within(1, 0.6), within(2, -500)], [45, -20, 1, -180]);
});
