// Actions and macros as text for the clipboard: JSON with the names of their servos, so that another robot can take them.

import { fitCaption, LONGEST, targetOf } from "./records.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Action} Action */
/** @typedef {import("./records.js").Macro} Macro */
/** @typedef {import("./records.js").Command} Command */
/** Servo with its caption, and the part of the figure that it turns; both may be empty. @typedef {{ id: number, caption: string, part: string }} NamedServo */
/** @typedef {{ servos: NamedServo[], actions: Action[], macros: Macro[] }} Motions */

const KIND = "servolink motions",
  VERSION = 1;
const MOST_TEXT = 1_000_000; // characters
const MOST_RECORDS = 1000; // of each kind, of steps and of commands
const MOST_NAME = 64; // characters of a part of a figure
const I16 = 0x7fff,
  I32 = 0x7fff_ffff;
const FIELD = /** @type {const} */ ({ action: "action_id", macro: "macro_id", delay: "delay_ms" });

/**
 * Return an action or a macro as text, with everything that it runs.
 * @param {Project} project
 * @param {"action" | "macro"} type
 * @param {number} id
 * @param {readonly NamedServo[]} servos of the robot
 */
export function copiedText(project, type, id, servos) {
  /** @type {Set<Action>} */
  const actions = new Set();
  /** @type {Set<Macro>} */
  const macros = new Set();
  /** @param {"action" | "macro"} kind @param {number} wanted */
  const add = (kind, wanted) => {
    const action = kind === "action" && project.actions.find((each) => each.action_id === wanted),
      macro = kind === "macro" && project.macros.find((each) => each.macro_id === wanted);
    if (action) actions.add(action);
    if (!macro || macros.has(macro)) return;
    macros.add(macro);
    for (const command of macro.commands)
      if (command.type === "action" || command.type === "macro") add(command.type, targetOf(command));
  };
  add(type, id);
  const used = new Set([...actions].flatMap(({ steps }) => steps.map((step) => step.servo_id)));
  const named = [...used].map(
    (servo) => servos.find((each) => each.id === servo) ?? { id: servo, caption: "", part: "" },
  );
  return JSON.stringify({ kind: KIND, version: VERSION, servos: named, actions: [...actions], macros: [...macros] });
}

/**
 * Return the actions and macros in a text from the clipboard, which may be any text; null for any other text.
 * @param {string} text
 * @returns {Motions | null}
 */
export function motionsIn(text) {
  if (text.length > MOST_TEXT) return null;
  try {
    const { kind, version, servos, actions, macros } = JSON.parse(text);
    if (kind !== KIND || version !== VERSION) return null;
    return { servos: list(servos, servoOf), actions: list(actions, actionOf), macros: list(macros, macroOf) };
  } catch {
    return null; // no JSON, or a value that no copy has
  }
}

/**
 * Return the items of an untrusted list. Throws RangeError for a list that is too long, or a wrong item.
 * @template T
 * @param {any} values
 * @param {(value: any) => T} read
 * @returns {T[]}
 */
function list(values, read) {
  if (!Array.isArray(values) || values.length > MOST_RECORDS) throw new RangeError("list");
  return values.map(read);
}

/**
 * @param {any} value
 * @param {number} low
 * @param {number} high
 * @returns {number}
 */
function integer(value, low, high) {
  if (!Number.isInteger(value) || value < low || value > high) throw new RangeError("number");
  return value;
}

/**
 * @param {any} value
 * @returns {string}
 */
function textOf(value) {
  if (typeof value !== "string") throw new RangeError("text");
  return value.replace(/\p{Cs}/gu, "\ufffd");
}

/** @param {any} value @returns {NamedServo} */
const servoOf = (value) => ({
  id: integer(value.id, 0, 255),
  caption: fitCaption(textOf(value.caption)),
  part: textOf(value.part).slice(0, MOST_NAME),
});

/** @param {any} value @returns {Action} */
const actionOf = (value) => ({
  action_id: integer(value.action_id, 1, I32),
  action_caption: fitCaption(textOf(value.action_caption)),
  steps: list(value.steps, (step) => ({
    servo_id: integer(step.servo_id, 0, 255),
    degree: integer(step.degree, -I16, I16),
    interval_ms: integer(step.interval_ms, 0, LONGEST),
  })),
});

/** @param {any} value @returns {Macro} */
const macroOf = (value) => ({
  macro_id: integer(value.macro_id, 1, I32),
  macro_caption: fitCaption(textOf(value.macro_caption)),
  commands: list(value.commands, commandIn).flatMap((command) => command ?? []),
});

/** @param {any} value @returns {Command | null} null for a command of an unknown type, which means nothing elsewhere */
function commandIn(value) {
  if (value.type === "other") return null;
  if (!Object.hasOwn(FIELD, value.type)) throw new RangeError("type");
  const type = /** @type {keyof typeof FIELD} */ (value.type),
    field = FIELD[type];
  return {
    type,
    [field]: integer(value[field], 0, I32),
    ratio_percent: integer(value.ratio_percent, 0, 100),
    loop: integer(value.loop, 0, I16),
    total_interval_ms: 0,
  };
}
