// Changes of macros: each function takes a macro and returns another one.

import { inOrder } from "./durations.js";

/** @typedef {import("./records.js").Macro} Macro */
/** @typedef {import("./records.js").Command} Command */
/** @typedef {import("./records.js").Project} Project */

/**
 * Return a new command.
 * @param {"action" | "macro" | "delay"} type
 * @param {number} value id, or milliseconds
 * @returns {Command}
 */
export function commandOf(type, value) {
  const field = { action: "action_id", macro: "macro_id", delay: "delay_ms" }[type];
  return { type, [field]: value, ratio_percent: 100, loop: 1, total_interval_ms: 0 };
}

/**
 * Return the macro with a command put in at a place.
 * @param {Macro} macro
 * @param {number} at
 * @param {Command} command
 * @returns {Macro}
 */
export const withCommandAt = (macro, at, command) => ({ ...macro, commands: macro.commands.toSpliced(at, 0, command) });

/**
 * Return the macro with a command changed.
 * @param {Macro} macro
 * @param {number} at
 * @param {Partial<Command>} changes
 * @returns {Macro}
 */
export const withCommand = (macro, at, changes) => ({
  ...macro,
  commands: macro.commands.with(at, { ...macro.commands[at], ...changes }),
});

/**
 * Return the macro without a command.
 * @param {Macro} macro
 * @param {number} at
 * @returns {Macro}
 */
export const withoutCommandAt = (macro, at) => ({ ...macro, commands: macro.commands.toSpliced(at, 1) });

/**
 * Return the macro with a command moved to another place.
 * @param {Macro} macro
 * @param {number} from
 * @param {number} to its index afterwards
 * @returns {Macro}
 */
export const withMoved = (macro, from, to) => ({
  ...macro,
  commands: macro.commands.toSpliced(from, 1).toSpliced(to, 0, macro.commands[from]),
});

/**
 * Return the macros that a macro can call without calling itself through them.
 * @param {Project} project
 * @param {Macro} macro
 */
export function callable(project, macro) {
  const runs = (/** @type {Macro} */ other) => {
    const trial = { ...macro, commands: [commandOf("macro", other.macro_id)] };
    const macros = project.macros.map((each) => (each.macro_id === macro.macro_id ? trial : each));
    return inOrder(macros).has(macro.macro_id);
  };
  return project.macros.filter((other) => other.macro_id !== macro.macro_id && runs(other));
}
