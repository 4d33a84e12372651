// Compiler of blocks: makes actions, macros and buttons of a program, and names each block that no board can run.

import { blocksOf } from "./block-form.js";
import { differencesOf } from "./differences.js";
import { durations, inOrder, withDurations } from "./durations.js";
import { buttonOf, withButton, withNewTable } from "./edit-buttons.js";
import { commandOf } from "./edit-macro.js";
import { callersOf, fitCaption, idOf, LONGEST, targetOf, withoutAction, withoutMacro, withRecord } from "./records.js";

/** @typedef {import("./block-form.js").Block} Block */
/** @typedef {import("./block-form.js").Program} Program */
/** @typedef {import("./block-form.js").Made} Made */
/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Command} Command */
/** @typedef {import("./records.js").Step} Step */
/** @typedef {import("../texts/text.js").Key} Key */
/** Refused block, or loose block to leave out, with the reason. @typedef {{ block: string, reason: Key, values: Record<string, string | number>, isLeftOut: boolean }} Problem */
/** @typedef {{ project: Project, made: Made[], problems: Problem[] }} Compiled */
/** A macro to make, with the block that each command comes from. @typedef {{ kind: "macros" | "buttons", id: number, caption: string, block: string, commands: Command[], sources: string[] }} Sheet */

const UNIT = 10; // milliseconds of a step
const MOST_RECORDS = 1820; // in a list of the board
const MOST_LEVELS = 32; // of macros inside macros
const MOST_LOOPS = 0x7fff;
const LONGEST_WAIT = 0x7fff_ffff; // milliseconds
const MOST_DEGREES = 0x7fff;
/** Field of a button by the event of a block. */
const SLOT = /** @type {const} */ ({
  press: "button_press_macro",
  long_press: "button_long_press_macro",
  up: "button_up_macro",
});

/**
 * Return the project with everything that the blocks make, or unchanged if a block is refused.
 * @param {Program} program
 * @param {Project} project
 * @param {readonly number[]} servoIds of the robot; unchecked if empty
 * @returns {Compiled}
 */
export function compile(program, project, servoIds = []) {
  const compiler = new Compiler(program, project, servoIds);
  for (const { blocks } of program.stacks) compiler.take(blocks);
  return compiler.result();
}

/**
 * Return the records made of blocks that the project still holds under their names.
 * @param {Pick<Program, "made">} program
 * @param {Project} project
 */
export const stillMade = ({ made }, project) =>
  made.filter(({ kind, id, caption }) =>
    kind === "actions"
      ? project.actions.some((one) => one.action_id === id && one.action_caption === caption)
      : project.macros.some((one) => one.macro_id === id && one.macro_caption === caption),
  );

class Compiler {
  /**
   * @param {Program} program
   * @param {Project} project
   * @param {readonly number[]} servoIds
   */
  constructor(program, project, servoIds) {
    this._project = project;
    this._servoIds = new Set(servoIds);
    this._before = stillMade(program, project);
    this._blocks = new Map(blocksOf(program).map((block) => [block.id, block]));
    /** @type {Map<string, { id: number, steps: Step[] }>} */
    this._actions = new Map();
    /** @type {Map<string, Sheet>} */
    this._macros = new Map();
    /** Id of each record to make, by kind and caption. @type {Map<string, number>} */
    this._ids = new Map();
    this._used = {
      actions: new Set(project.actions.map((one) => one.action_id)),
      macros: new Set(project.macros.map((one) => one.macro_id)),
    };
    /** @type {Problem[]} */
    this.problems = [];
  }

  /**
   * Take a stack of blocks.
   * @param {readonly Block[]} blocks
   */
  take(blocks) {
    const [first] = blocks;
    if (first.type === "macro") this._defineMacro(first);
    else if (first.type === "button") this._defineButton(first);
    else if (first.type === "pose" && blocks.length === 1) this._action(first);
    else this._refuse(first, "blocks.why_loose", {}, true);
  }

  /** @returns {Compiled} */
  result() {
    const after = this._built();
    this._checkMacros(after);
    const isRefused = this.problems.some((problem) => !problem.isLeftOut);
    const isSame = differencesOf(this._project, after).length === 0;
    const made = this._made();
    const left = stillMade({ made: this._before }, after).filter(
      (one) => !made.some((other) => isSameRecord(one, other)),
    );
    return {
      project: isRefused || isSame ? this._project : after,
      made: [...made, ...left],
      problems: this.problems,
    };
  }

  /**
   * @param {Block} block
   * @param {Key} reason
   * @param {Record<string, string | number>} [values]
   */
  _refuse(block, reason, values = {}, isLeftOut = false) {
    if (!this.problems.some((problem) => problem.block === block.id && problem.reason === reason))
      this.problems.push({ block: block.id, reason, values, isLeftOut });
    return null;
  }

  /** @param {Block} block */
  _defineMacro(block) {
    const caption = this._caption(block);
    if (caption !== null && this._macros.has(caption)) this._refuse(block, "blocks.why_twice", { name: caption });
    this._define("macros", caption, block);
  }

  /** @param {Block} block */
  _defineButton(block) {
    const { button_id = 0, event = "press" } = block,
      caption = `button ${button_id} ${event.replace("_", " ")}`;
    if (!isWhole(button_id, 0, 0xffff_ffff)) this._refuse(block, "blocks.why_button");
    if (this._macros.has(caption)) this._refuse(block, "blocks.why_button_twice", { id: button_id });
    const present = buttonOf(tableOf(this._project), button_id)[SLOT[event]];
    const isOurs = this._before.some((one) => one.kind === "buttons" && one.id === present);
    if (present !== 0 && !isOurs) this._refuse(block, "blocks.why_button_taken", { id: button_id });
    this._define("buttons", caption, block);
  }

  /**
   * Define a macro with the commands inside a block, which are checked also if the macro itself is refused.
   * @param {Sheet["kind"]} kind
   * @param {string | null} caption
   * @param {Block} block
   * @returns {Sheet | null}
   */
  _define(kind, caption, block) {
    const id = caption === null ? null : this._idFor("macros", caption, block);
    /** @type {Sheet} */
    const sheet = { kind, id: id ?? 0, caption: caption ?? "", block: block.id, commands: [], sources: [] };
    if (id !== null && !this._macros.has(sheet.caption)) this._macros.set(sheet.caption, sheet);
    for (const inner of block.blocks ?? []) this._command(inner, sheet);
    if ((block.blocks ?? []).length === 0) this._refuse(block, "blocks.why_empty");
    return id === null ? null : sheet;
  }

  /**
   * Add the command of a block to a macro.
   * @param {Block} block
   * @param {Sheet} sheet
   */
  _command(block, sheet) {
    const command = this._commandOf(block, sheet.caption);
    if (command === null) return;
    sheet.commands.push(command);
    sheet.sources.push(block.id);
  }

  /**
   * @param {Block} block
   * @param {string} caption of the macro
   * @returns {Command | null}
   */
  _commandOf(block, caption) {
    switch (block.type) {
      case "pose": {
        const action = this._action(block);
        return action && commandOf("action", action.id);
      }
      case "run_action":
      case "run_macro":
        return this._run(block);
      case "wait":
        return isWhole(block.delay_ms, 0, LONGEST_WAIT)
          ? commandOf("delay", block.delay_ms ?? 0)
          : this._refuse(block, "blocks.why_wait");
      case "repeat":
        return this._repeat(block, caption);
      case "forever":
        return this._refuse(block, "blocks.why_forever");
      case "if":
        return this._refuse(block, "blocks.why_if");
      default:
        return this._refuse(block, "blocks.why_loose");
    }
  }

  /** @param {Block} block */
  _run(block) {
    const type = block.type === "run_action" ? "action" : "macro";
    const id = this._target(block, type);
    if (id === undefined) return null; // the block to run is refused itself
    if (id === null) return this._refuse(block, type === "action" ? "blocks.why_no_action" : "blocks.why_no_macro");
    if (!isWhole(block.ratio_percent, 1, 100)) return this._refuse(block, "blocks.why_speed");
    return { ...commandOf(type, id), ratio_percent: block.ratio_percent ?? 100 };
  }

  /**
   * Return the id of the record to run by a block: null for a missing record, undefined if the record is refused.
   * @param {Block} block
   * @param {"action" | "macro"} type
   */
  _target({ target = "" }, type) {
    const [word, name] = [target.slice(0, target.indexOf(" ")), target.slice(target.indexOf(" ") + 1)];
    if (word === type) {
      const records = type === "action" ? this._project.actions : this._project.macros;
      return records.some((record) => idOf(type === "action" ? "actions" : "macros", record) === Number(name))
        ? Number(name)
        : null;
    }
    const block = word === "block" ? this._blocks.get(name) : undefined;
    if (block?.type !== (type === "action" ? "pose" : "macro")) return null;
    if (type === "action") return this._action(block)?.id;
    const caption = this._caption(block);
    return caption === null ? undefined : (this._idFor("macros", caption, block) ?? undefined);
  }

  /**
   * Return the command for a repeat: the command inside with a loop, or a macro of its own for more than one.
   * @param {Block} block
   * @param {string} caption of the macro around
   */
  _repeat(block, caption) {
    const { loop = 1, blocks = [] } = block;
    if (!isWhole(loop, 1, MOST_LOOPS)) return this._refuse(block, "blocks.why_loop", { most: MOST_LOOPS });
    if (blocks.length === 0) return this._refuse(block, "blocks.why_empty");
    if (blocks.length === 1) {
      const command = this._commandOf(blocks[0], caption);
      if (command === null) return null;
      if (command.loop * loop <= MOST_LOOPS) return { ...command, loop: command.loop * loop };
    }
    const base = caption.replace(/\.\d+$/, "");
    let number = 1;
    const next = () => `${shortened(base, `.${number}`)}.${number}`;
    while (this._macros.has(next()) || this._isForeign("macros", next())) number++;
    const sheet = this._define("macros", next(), block);
    return sheet && { ...commandOf("macro", sheet.id), loop };
  }

  /**
   * Return the action of a pose; poses of one name must be equal.
   * @param {Block} block
   */
  _action(block) {
    const caption = this._caption(block);
    if (caption === null) return null;
    const steps = this._steps(block);
    if (steps === null) return null;
    const known = this._actions.get(caption);
    if (known) {
      const isEqual = JSON.stringify(known.steps) === JSON.stringify(steps);
      return isEqual ? known : this._refuse(block, "blocks.why_pose_differs", { name: caption });
    }
    const id = this._idFor("actions", caption, block);
    if (id === null) return null;
    const action = { id, steps };
    this._actions.set(caption, action);
    return action;
  }

  /** @param {Block} block */
  _steps(block) {
    const { interval_ms = 0, blocks = [] } = block;
    if (blocks.length === 0) return this._refuse(block, "blocks.why_no_servos");
    if (!isWhole(interval_ms, UNIT, LONGEST)) return this._refuse(block, "blocks.why_interval");
    const rounded = Math.round(interval_ms / UNIT) * UNIT;
    /** @type {Map<number, Step>} */
    const steps = new Map();
    for (const inner of blocks) {
      const { servo_id = 0, degree = 0 } = inner;
      if (this._servoIds.size > 0 && !this._servoIds.has(servo_id))
        return this._refuse(inner, "blocks.why_no_servo", { id: servo_id });
      if (!isWhole(servo_id, 0, 0xff) || !isWhole(degree, -MOST_DEGREES - 1, MOST_DEGREES))
        return this._refuse(inner, "blocks.why_angle");
      if (steps.has(servo_id)) return this._refuse(inner, "blocks.why_servo_twice", { id: servo_id });
      steps.set(servo_id, { servo_id, degree, interval_ms: rounded });
    }
    return [...steps.values()].sort((a, b) => a.servo_id - b.servo_id);
  }

  /**
   * Return the name of a block, if a board can store it.
   * @param {Block} block
   */
  _caption(block) {
    const caption = (block.caption ?? "").trim();
    if (caption === "" || /\p{Cc}/u.test(caption)) return this._refuse(block, "blocks.why_no_name");
    return fitCaption(caption) === caption ? caption : this._refuse(block, "blocks.why_name_long");
  }

  /**
   * Return the id for a record of a name: that of the record made before, or a free one.
   * @param {"actions" | "macros"} kind
   * @param {string} caption
   * @param {Block} block
   */
  _idFor(kind, caption, block) {
    const key = `${kind} ${caption}`,
      used = this._used[kind],
      known = this._ids.get(key) ?? this._madeBefore(kind, caption)?.id;
    if (known === undefined && this._isForeign(kind, caption))
      return this._refuse(block, "blocks.why_taken", { name: caption });
    if (known === undefined && used.size >= MOST_RECORDS)
      return this._refuse(block, "blocks.why_full", { most: MOST_RECORDS });
    const id = known ?? lowestBeyond(used);
    used.add(id);
    this._ids.set(key, id);
    return id;
  }

  /**
   * @param {"actions" | "macros"} kind
   * @param {string} caption
   */
  _madeBefore(kind, caption) {
    return this._before.find((one) => (one.kind === "actions") === (kind === "actions") && one.caption === caption);
  }

  /**
   * Return whether the project has a record of a name that was not made of blocks.
   * @param {"actions" | "macros"} kind
   * @param {string} caption
   */
  _isForeign(kind, caption) {
    const isNamed =
      kind === "actions"
        ? this._project.actions.some((one) => one.action_caption === caption)
        : this._project.macros.some((one) => one.macro_caption === caption);
    return isNamed && this._madeBefore(kind, caption) === undefined;
  }

  /** @returns {Made[]} */
  _made() {
    const actions = [...this._actions].map(
      ([caption, { id }]) => /** @type {Made} */ ({ kind: "actions", id, caption }),
    );
    return [...actions, ...[...this._macros.values()].map(({ kind, id, caption }) => ({ kind, id, caption }))];
  }

  /** Return the project with the new records of the blocks, without the records of deleted blocks. */
  _built() {
    let after = this._withoutButtons(this._project);
    for (const [action_caption, { id, steps }] of this._actions)
      after = withRecord(after, "actions", { action_id: id, action_caption, steps });
    for (const { id, caption, commands } of this._macros.values())
      after = withRecord(after, "macros", { macro_id: id, macro_caption: caption, commands });
    after = this._withButtons(this._withoutStale(after));
    return withDurations(this._project, after);
  }

  /**
   * Return the project without the buttons that start macros made of button blocks.
   * @param {Project} project
   */
  _withoutButtons(project) {
    const ours = new Set(this._before.filter((one) => one.kind === "buttons").map((one) => one.id));
    let after = project;
    for (const { table_id, buttons } of project.joystick_tables)
      for (const button of buttons)
        for (const slot of Object.values(SLOT))
          if (ours.has(button[slot])) after = withButton(after, table_id, button.button_id, { [slot]: 0 });
    return after;
  }

  /** @param {Project} project */
  _withButtons(project) {
    const buttons = [...this._macros.values()].filter(({ kind }) => kind === "buttons");
    if (buttons.length === 0) return project;
    let after = tableOf(project) ? project : withNewTable(project, "Blocks")[0];
    const tableId = tableOf(after)?.table_id ?? 0;
    for (const { id, block } of buttons) {
      const { button_id = 0, event = "press" } = /** @type {Block} */ (this._blocks.get(block));
      after = withButton(after, tableId, button_id, { [SLOT[event]]: id });
    }
    return after;
  }

  /**
   * Return the project without records that were made of blocks before and are no longer, unless others run them.
   * @param {Project} project
   */
  _withoutStale(project) {
    const made = this._made();
    let after = project,
      stale = this._before.filter((one) => !made.some((other) => isSameRecord(one, other)));
    for (let count = -1; count !== stale.length;) {
      count = stale.length;
      for (const { kind, id } of stale) {
        const isAction = kind === "actions";
        if (callersOf(after, isAction ? "action" : "macro", id).length > 0 || (!isAction && startsMacro(after, id)))
          continue;
        after = isAction ? withoutAction(after, id) : withoutMacro(after, id);
      }
      stale = stillMade({ made: stale }, after);
    }
    return after;
  }

  /**
   * Refuse blocks whose macro would never end, would nest too deep, or would last too long.
   * @param {Project} after
   */
  _checkMacros(after) {
    const macros = inOrder(after.macros),
      times = durations(after);
    /** @type {Map<number, number>} */
    const levels = new Map();
    for (const [id, { commands }] of macros)
      levels.set(
        id,
        1 + Math.max(0, ...commands.map((each) => (each.type === "macro" ? (levels.get(targetOf(each)) ?? 0) : 0))),
      );
    for (const sheet of this._macros.values())
      sheet.commands.forEach((command, at) => {
        const block = /** @type {Block} */ (this._blocks.get(sheet.sources[at])),
          target = targetOf(command);
        if (command.type === "macro" && !macros.has(target)) this._refuse(block, "blocks.why_circle");
        else if (command.type === "macro" && levels.get(target) === MOST_LEVELS)
          this._refuse(block, "blocks.why_deep", { most: MOST_LEVELS });
        else if (times.get(sheet.id)?.[at] === null && !(command.type === "macro" && times.get(target)?.includes(null)))
          this._refuse(block, "blocks.why_long");
      });
  }
}

/**
 * Return the table for button blocks: the active one, or the first.
 * @param {Project} project
 */
const tableOf = ({ joystick_tables, active_joystick_table }) =>
  joystick_tables.find((table) => table.table_id === active_joystick_table) ?? joystick_tables[0];

/**
 * @param {Project} project
 * @param {number} id of a macro
 */
const startsMacro = ({ joystick_tables }, id) =>
  joystick_tables.some(({ buttons }) =>
    buttons.some((button) => Object.values(SLOT).some((slot) => button[slot] === id)),
  );

/**
 * Return the lowest id that is not used.
 * @param {ReadonlySet<number>} used
 */
function lowestBeyond(used) {
  let id = 1;
  while (used.has(id)) id++;
  return id;
}

/**
 * @param {Made} one
 * @param {Made} other
 */
const isSameRecord = (one, other) => one.id === other.id && (one.kind === "actions") === (other.kind === "actions");

/**
 * @param {number | undefined} value
 * @param {number} low
 * @param {number} high
 */
const isWhole = (value, low, high) => Number.isInteger(value) && Number(value) >= low && Number(value) <= high;

/**
 * Return the beginning of a caption that leaves room for an ending.
 * @param {string} caption
 * @param {string} ending of ASCII
 */
function shortened(caption, ending) {
  const characters = [...caption];
  while (fitCaption(`${characters.join("")}${ending}`) !== `${characters.join("")}${ending}`) characters.pop();
  return characters.join("");
}
