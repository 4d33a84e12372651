// Programs made of blocks: the records that they become, and the blocks that no board can run.

import assert from "node:assert/strict";
import { test } from "node:test";

const { compile } = await import("../../../servolink/studio/web/state/block-compiler.js");
const { blocksOf, fromBlockly, toBlockly } = await import("../../../servolink/studio/web/state/block-form.js");

const EMPTY = {
  schema: 1,
  project_id: 0,
  servo_parameters: [],
  actions: [],
  macros: [],
  joystick_tables: [],
  active_joystick_table: null,
};

let count = 0;
const block = (type, values = {}, blocks = undefined) => ({
  type,
  id: `${type}${++count}`,
  ...values,
  ...(blocks && { blocks }),
});
const pose = (caption, degrees, interval_ms = 500) =>
  block(
    "pose",
    { caption, interval_ms },
    Object.entries(degrees).map(([servo_id, degree]) => block("servo", { servo_id: Number(servo_id), degree })),
  );
const wait = (delay_ms) => block("wait", { delay_ms });
const repeat = (loop, ...blocks) => block("repeat", { loop }, blocks);
const macro = (caption, ...blocks) => block("macro", { caption }, blocks);
const button = (button_id, event, ...blocks) => block("button", { button_id, event }, blocks);
const program = (...firsts) => ({
  blocks: 1,
  stacks: firsts.map((first) => ({ x: 0, y: 0, blocks: [first].flat() })),
  made: [],
});

/** Return the commands of a macro in short, such as `action 1 x3`. */
const shown = (project, caption) =>
  project.macros
    .find((one) => one.macro_caption === caption)
    .commands.map(
      (one) =>
        `${one.type} ${one.action_id ?? one.macro_id ?? one.delay_ms}${one.loop === 1 ? "" : ` x${one.loop}`}${one.ratio_percent === 100 ? "" : ` at ${one.ratio_percent}`}`,
    );
/** Return the reasons why blocks are refused, by type of block. */
const reasons = (made, program) => {
  const types = new Map(blocksOf(program).map((one) => [one.id, one.type]));
  return made.problems.map((one) => `${types.get(one.block)} ${one.reason.replace("blocks.why_", "")}`);
};

test("a macro of poses, waits and repeats becomes actions and macros", () => {
  const up = pose("Up", { 2: 40, 1: -5 });
  const made = compile(
    program(macro("Wave", up, repeat(3, wait(100)), repeat(2, pose("Down", { 1: 0 }), wait(250)))),
    EMPTY,
  );
  assert.deepEqual(made.problems, []);
  assert.deepEqual(made.project.actions[0], {
    action_id: 1,
    action_caption: "Up",
    steps: [
      { servo_id: 1, degree: -5, interval_ms: 500 },
      { servo_id: 2, degree: 40, interval_ms: 500 },
    ],
  });
  assert.deepEqual(shown(made.project, "Wave"), ["action 1", "delay 100 x3", "macro 2 x2"]);
  assert.deepEqual(shown(made.project, "Wave.1"), ["action 2", "delay 250"]);
  assert.deepEqual(
    made.project.macros[0].commands.map((one) => one.total_interval_ms),
    [500, 300, 1500],
  );
});

test("equal poses of a name are one action, and repeats of one command are one command", () => {
  const made = compile(program(macro("M", pose("A", { 1: 9 }), repeat(4, repeat(5, pose("A", { 1: 9 }))))), EMPTY);
  assert.deepEqual(shown(made.project, "M"), ["action 1", "action 1 x20"]);
  assert.equal(made.project.actions.length, 1);
});

test("blocks run stored records, and those of other blocks that come later", () => {
  const stored = {
    ...EMPTY,
    actions: [{ action_id: 7, action_caption: "Bow", steps: [] }],
    macros: [{ macro_id: 1, macro_caption: "Old", commands: [] }],
  };
  const later = macro("Later", wait(10)),
    alone = pose("Alone", { 1: 1 });
  const run = (type, target) => block(type, { target, ratio_percent: 50 });
  const first = macro(
    "First",
    run("run_action", "action 7"),
    run("run_macro", "macro 1"),
    run("run_macro", `block ${later.id}`),
    run("run_action", `block ${alone.id}`),
  );
  const made = compile(program(first, later, alone), stored);
  assert.deepEqual(made.problems, []);
  assert.deepEqual(shown(made.project, "First"), [
    "action 7 at 50",
    "macro 1 at 50",
    "macro 3 at 50",
    "action 1 at 50",
  ]);
});

test("buttons start macros of the active table, and leave other buttons alone", () => {
  const other = {
    button_id: 1,
    button_caption: "",
    button_press_macro: 1,
    button_long_press_macro: 0,
    button_up_macro: 0,
    uninterruptible: 0,
  };
  const stored = {
    ...EMPTY,
    macros: [{ macro_id: 1, macro_caption: "Old", commands: [] }],
    joystick_tables: [
      { table_id: 3, table_caption: "First", buttons: [] },
      { table_id: 4, table_caption: "Active", buttons: [other] },
    ],
    active_joystick_table: 4,
  };
  const made = compile(program(button(1, "up", wait(10)), button(2, "press", wait(20))), stored);
  const [first, active] = made.project.joystick_tables;
  assert.deepEqual(first.buttons, []);
  assert.deepEqual(active.buttons, [
    { ...other, button_up_macro: 2 },
    { ...other, button_id: 2, button_press_macro: 3 },
  ]);
  const again = compile({ ...program(button(2, "press", wait(30))), made: made.made }, made.project);
  assert.deepEqual(again.project.joystick_tables[1].buttons, [
    other,
    { ...other, button_id: 2, button_press_macro: 3 },
  ]);
  assert.equal(compile(program(button(1, "press", wait(5))), EMPTY).project.active_joystick_table, 1);
});

test("making again changes what was made, and nothing else", () => {
  const blocks = program(macro("Wave", pose("Up", { 1: 5 }), wait(100), repeat(2, wait(1), wait(2))));
  const first = compile(blocks, EMPTY);
  const same = compile({ ...blocks, made: first.made }, first.project);
  assert.equal(same.project, first.project);
  const fewer = { ...program(macro("Wave", wait(100))), made: first.made };
  const second = compile(fewer, first.project);
  assert.deepEqual([second.project.actions, shown(second.project, "Wave")], [[], ["delay 100"]]);
  assert.deepEqual(second.made, [{ kind: "macros", id: 1, caption: "Wave" }]);
  const used = {
    ...first.project,
    macros: [
      ...first.project.macros,
      { macro_id: 9, macro_caption: "Mine", commands: first.project.macros[0].commands },
    ],
  };
  const third = compile({ ...fewer, made: first.made }, used);
  assert.deepEqual(third.project.actions, used.actions); // `Mine` runs the action still
  assert.equal(third.made.length, 3);
});

test("a record of the same name that was not made of blocks is not overwritten", () => {
  const stored = { ...EMPTY, actions: [{ action_id: 1, action_caption: "Up", steps: [] }] };
  const blocks = program(macro("Wave", pose("Up", { 1: 5 })));
  const made = compile(blocks, stored);
  assert.deepEqual(reasons(made, blocks), ["pose taken"]);
  assert.equal(made.project, stored);
});

test("each block that no board can run is refused with a reason", () => {
  const inner = macro("Inner", wait(10));
  const cases = [
    [macro("M", block("forever", {}, [wait(1)])), "forever forever"],
    [macro("M", block("if", { servo_id: 1, degree: 9 }, [wait(1)])), "if if"],
    [macro("M", wait(2 ** 31)), "wait wait"],
    [macro("M", repeat(40_000, wait(1))), "repeat loop"],
    [macro("M", repeat(30_000, wait(2 ** 30))), "repeat long"],
    [macro("M", repeat(2)), "repeat empty"],
    [macro("M"), "macro empty"],
    [macro("", wait(1)), "macro no_name"],
    [macro("x".repeat(33), wait(1)), "macro name_long"],
    [macro("M", pose("P", {})), "pose no_servos"],
    [macro("M", pose("P", { 1: 5 }, 400_000)), "pose interval"],
    [macro("M", pose("P", { 9: 5 })), "servo no_servo"],
    [macro("M", pose("P", { 1: 40_000 })), "servo angle"],
    [macro("M", pose("P", { 1: 5 }), pose("P", { 1: 6 })), "pose pose_differs"],
    [macro("M", block("run_action", { target: "action 1", ratio_percent: 100 })), "run_action no_action"],
    [macro("M", block("run_macro", { target: "", ratio_percent: 100 })), "run_macro no_macro"],
    [macro("M", block("run_macro", { target: `block ${inner.id}`, ratio_percent: 0 })), "run_macro speed"],
    [button(-1, "press", wait(1)), "button button"],
  ];
  for (const [first, reason] of cases) {
    const blocks = program(first, inner);
    const made = compile(blocks, EMPTY, [1, 2]);
    assert.deepEqual([reasons(made, blocks), made.project], [[reason], EMPTY]);
  }
});

test("twice the same name, servo or button is refused", () => {
  const twice = pose("P", { 1: 5 });
  twice.blocks.push(block("servo", { servo_id: 1, degree: 6 }));
  const cases = [
    [program(macro("M", wait(1)), macro("M", wait(1))), "macro twice"],
    [program(macro("M", twice)), "servo servo_twice"],
    [program(button(1, "up", wait(1)), button(1, "up", wait(1))), "button button_twice"],
  ];
  for (const [blocks, reason] of cases) assert.deepEqual(reasons(compile(blocks, EMPTY), blocks), [reason]);
  const table = { table_id: 1, table_caption: "", buttons: [{ button_id: 1, button_press_macro: 5 }] };
  const taken = program(button(1, "press", wait(1)));
  assert.deepEqual(reasons(compile(taken, { ...EMPTY, joystick_tables: [table] }), taken), ["button button_taken"]);
});

test("macros that run themselves or nest too deep are refused", () => {
  const circle = macro("A");
  circle.blocks = [block("run_macro", { target: `block ${circle.id}`, ratio_percent: 100 })];
  assert.deepEqual(reasons(compile(program(circle), EMPTY), program(circle)), ["run_macro circle"]);
  const nested = (depth) => (depth === 0 ? [wait(1)] : [repeat(1, wait(1), ...nested(depth - 1))]);
  const fits = program(macro("M", ...nested(31))),
    deep = program(macro("M", ...nested(32)));
  assert.deepEqual(reasons(compile(fits, EMPTY), fits), []);
  assert.deepEqual(reasons(compile(deep, EMPTY), deep), ["repeat deep"]);
});

test("blocks beyond what a board can list are refused", () => {
  const actions = Array.from({ length: 1820 }, (_, at) => ({ action_id: at + 1, action_caption: `${at}`, steps: [] }));
  const blocks = program(macro("M", pose("P", { 1: 5 })));
  assert.deepEqual(reasons(compile(blocks, { ...EMPTY, actions }), blocks), ["pose full"]);
});

test("loose blocks are left out, and do not keep others from being made", () => {
  const blocks = program([wait(1), wait(2)], macro("M", wait(3)));
  const made = compile(blocks, EMPTY);
  assert.deepEqual([reasons(made, blocks), shown(made.project, "M")], [["wait loose"], ["delay 3"]]);
});

test("long names leave room for the number of a repeat", () => {
  const name = "機".repeat(10);
  const made = compile(program(macro(name, repeat(2, wait(1), wait(2)))), EMPTY);
  assert.deepEqual(
    made.project.macros.map((one) => one.macro_caption),
    [name, `${name}.1`],
  );
  const longer = compile(program(macro("x".repeat(32), repeat(2, wait(1), wait(2)))), EMPTY);
  assert.equal(longer.project.macros[1].macro_caption, `${"x".repeat(30)}.1`);
});

test("a program is the same after Blockly has read and written it", () => {
  const all = program(
    macro("W", pose("P", { 1: 5, 2: -6 }), repeat(2, wait(1500), block("if", { servo_id: 1, degree: 3 }, []))),
    button(3, "long_press", block("run_action", { target: "action 2", ratio_percent: 80 }), block("forever", {}, [])),
    [block("servo", { servo_id: 1, degree: 2 }), block("servo", { servo_id: 2, degree: 3 })],
  );
  assert.deepEqual(fromBlockly(toBlockly(all)), all.stacks);
  assert.deepEqual(fromBlockly({}), []);
});
