// Motions between robots: clipboard.js and pasting.js.

import assert from "node:assert/strict";
import { test } from "node:test";
import { projectForm } from "./page.mjs";

const state = "../../../servolink/studio/web/state/";
const { copiedText, motionsIn } = await import(`${state}clipboard.js`);
const { pairsOf, pasted } = await import(`${state}pasting.js`);

const named = (id, caption = "", part = "") => ({ id, caption, part });
const ROBOT = [named(1, "servo 1"), named(2, "servo 2")];
const copied = (type, id) => motionsIn(copiedText(projectForm(), type, id, ROBOT));
const empty = () => ({ ...projectForm(), actions: [], macros: [] });
const fit = (pairs, more = {}) => ({ pairs: new Map(pairs), mirror: null, percent: 100, ...more });

test("a macro is copied with all that it runs, and pasted with the same course", () => {
  const motions = copied("macro", 2);
  assert.deepEqual(
    motions.macros.map((one) => one.macro_id),
    [2, 1],
  );
  const { project, actions, macros, left } = pasted(empty(), motions, fit(pairsOf(motions.servos, ROBOT)));
  assert.deepEqual([actions, macros, left], [motions.actions.length, 2, []]);
  const [outer, inner] = project.macros;
  assert.equal(outer.commands.find((each) => each.type === "macro").macro_id, inner.macro_id);
  const ids = project.actions.map((one) => one.action_id);
  for (const command of inner.commands) if (command.type === "action") assert.ok(ids.includes(command.action_id));
});

test("servos are matched by caption, then by part, then by id; a name that two servos have matches none", () => {
  const theirs = [
    named(1, "R  Arm"),
    named(2, "twin"),
    named(3, "", "knee_r"),
    named(4),
    named(5, "lost"),
    named(6, "twin"),
  ];
  const ours = [named(9, "r arm"), named(8, "twin"), named(7, "x", "knee_r"), named(4), named(5)];
  const pairs = pairsOf(theirs, ours);
  assert.deepEqual(Object.fromEntries(pairs), { 1: 9, 2: null, 3: 7, 4: 4, 5: null, 6: null });
});

test("steps without a servo are left out, and an action without steps is named with the commands that run it gone", () => {
  const motions = copied("macro", 1);
  const half = pasted(empty(), motions, fit([[1, 5]]));
  assert.ok(half.project.actions.every((one) => one.steps.every((step) => step.servo_id === 5)));
  const none = pasted(empty(), motions, fit([]));
  assert.deepEqual(none.project.actions, []);
  assert.deepEqual(none.left, motions.actions.map((one) => one.action_caption)); // prettier-ignore
  assert.ok(none.project.macros[0].commands.every((command) => command.type === "delay"));
  const both = pasted(empty(), copied("action", 1), fit([[1, 5], [2, 5]])); // prettier-ignore
  assert.deepEqual(both.project.actions[0].steps, [{ servo_id: 5, degree: 90, interval_ms: 500 }]);
});

test("motions are mirrored and retimed if asked, in the units of the board", () => {
  const image = { factor: -1, offset: 0 };
  const mirror = new Map([[1, { ...image, servo: 2, is_right: false }], [2, { ...image, servo: 1, is_right: true }]]); // prettier-ignore
  const pairs = [[1, 1], [2, 2]]; // prettier-ignore
  const { project } = pasted(empty(), copied("action", 1), fit(pairs, { mirror, percent: 153 }));
  assert.deepEqual(project.actions[0].steps, [
    { servo_id: 1, degree: 30, interval_ms: 1530 },
    { servo_id: 2, degree: -90, interval_ms: 770 },
  ]);
});

test("an action that is there is used, and another one of its name gets a number", () => {
  const motions = copied("action", 1);
  const again = pasted(projectForm(), motions, fit([[1, 1], [2, 2]])); // prettier-ignore
  assert.equal(again.actions, 0);
  const slower = pasted(projectForm(), motions, fit([[1, 1], [2, 2]], { percent: 200 })); // prettier-ignore
  assert.equal(slower.project.actions.at(-1).action_caption, "up 2");
  const long = { ...motions, actions: [{ ...motions.actions[0], action_caption: "x".repeat(32) }] };
  const first = pasted(empty(), long, fit([[1, 1]]));
  const second = pasted(first.project, long, fit([[2, 2]]));
  assert.equal(second.project.actions[1].action_caption, `${"x".repeat(30)} 2`);
});

test("hostile texts are no motions", () => {
  const good = JSON.parse(copiedText(projectForm(), "macro", 1, ROBOT));
  const wrong = [
    {},
    { kind: "other" },
    { version: 2 },
    { servos: "x" },
    { actions: Array(2000).fill(good.actions[0]) },
    { actions: [{ ...good.actions[0], steps: [{ servo_id: 1, degree: 1e9, interval_ms: 1 }] }] },
    { actions: [{ ...good.actions[0], steps: [{ servo_id: 1.5, degree: 1, interval_ms: 1 }] }] },
    { actions: [{ ...good.actions[0], action_caption: { toString: "x" } }] },
    { macros: [{ ...good.macros[0], commands: [{ ...good.macros[0].commands[0], type: "constructor" }] }] },
  ];
  for (const each of wrong.slice(1))
    assert.equal(motionsIn(JSON.stringify({ ...good, ...each })), null, JSON.stringify(each).slice(0, 80));
  for (const text of ["", "null", "[]", "{", "<b>", JSON.stringify(good) + " ".repeat(1_000_000)])
    assert.equal(motionsIn(text), null);
  const odd = motionsIn(
    JSON.stringify({ ...good, __proto__: { polluted: 1 }, extra: 1, servos: [{ id: 1, caption: "\ud800", part: "" }] }),
  );
  assert.deepEqual(odd.servos, [named(1, "\ufffd")]);
  assert.equal({}.polluted, undefined);
});
