// Durations of the commands of macros, as `servolink/project/record_lookup.py` computes it.

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Macro} Macro */
/** @typedef {import("./records.js").Command} Command */

const MOST = 0x7fff_ffff; // milliseconds

/**
 * Return the macros by id, called macros first. Macros that call themselves are left out with their callers.
 * @param {readonly Macro[]} macros
 * @returns {Map<number, Macro>}
 */
export function inOrder(macros) {
  const byId = new Map(macros.map((macro) => [macro.macro_id, macro]));
  /** @type {Map<number, Macro>} */
  const done = new Map();
  const begun = new Set();
  /** @param {Macro} macro */
  const visit = (macro) => {
    if (done.has(macro.macro_id)) return true;
    if (begun.has(macro.macro_id)) return false;
    begun.add(macro.macro_id);
    for (const command of macro.commands) {
      const called = command.type === "macro" ? byId.get(command.macro_id ?? 0) : undefined;
      if (called && !visit(called)) return false;
    }
    done.set(macro.macro_id, macro);
    return true;
  };
  for (const macro of byId.values()) visit(macro);
  return done;
}

/**
 * Return, by macro id, the milliseconds of each command with speed and repeats; null for an unknown duration.
 * @param {Project} project
 * @returns {Map<number, (number | null)[]>}
 */
export function durations(project) {
  const actions = new Map(
    project.actions.map((one) => [one.action_id, Math.max(0, ...one.steps.map((step) => step.interval_ms))]),
  );
  /** @type {Map<number, number | null>} */
  const totals = new Map();
  const found = new Map(
    project.macros.map((macro) => [macro.macro_id, /** @type {(number | null)[]} */ (macro.commands.map(() => null))]),
  );
  for (const [id, macro] of inOrder(project.macros)) {
    const each = macro.commands.map((command) => durationOf(command, actions, totals));
    found.set(id, each);
    totals.set(id, each.includes(null) ? null : sumOf(each));
  }
  return found;
}

/**
 * Return the seconds of each macro as the board counts, by id; null for an unknown duration.
 * @param {Project} project
 */
export const macroSeconds = (project) =>
  new Map([...durations(project)].map(([id, each]) => [id, each.includes(null) ? null : sumOf(each) / 1000]));

/** @param {(number | null)[]} times */
const sumOf = (times) => times.reduce((/** @type {number} */ sum, time) => sum + (time ?? 0), 0);

/**
 * @param {Command} command
 * @param {Map<number, number>} actions
 * @param {Map<number, number | null>} macros
 */
function durationOf({ type, action_id = 0, macro_id = 0, delay_ms = 0, loop, ratio_percent }, actions, macros) {
  const once =
    { action: actions.get(action_id), macro: macros.get(macro_id), delay: delay_ms, other: null }[type] ?? null;
  if (once === null || once < 0 || loop < 0 || ratio_percent <= 0) return null;
  const halfUp = Math.floor((once * loop * 200 + ratio_percent) / (2 * ratio_percent));
  return halfUp <= MOST ? halfUp : null;
}

/**
 * Return `after` with the stated durations of its commands brought up to date. A command that stated another duration
 * on purpose keeps it, unless that command was changed.
 * @param {Project} before
 * @param {Project} after
 * @returns {Project}
 */
export function withDurations(before, after) {
  if (before.actions === after.actions && before.macros === after.macros) return after;
  const told = toldOf(before),
    right = durations(after);
  const macros = after.macros.map((macro) => {
    const takes = right.get(macro.macro_id) ?? [];
    const commands = macro.commands.map((command, at) => {
      const isOnPurpose = told.has(command) && told.get(command) !== command.total_interval_ms;
      const time = takes[at] ?? null;
      return isOnPurpose || time === null || time === command.total_interval_ms
        ? command
        : { ...command, total_interval_ms: time };
    });
    return commands.some((command, at) => command !== macro.commands[at]) ? { ...macro, commands } : macro;
  });
  return { ...after, macros };
}

/**
 * Return the duration of each command by itself.
 * @param {Project} project
 */
function toldOf(project) {
  const found = durations(project);
  return new Map(
    project.macros.flatMap((macro) =>
      macro.commands.map((command, at) => /** @type {const} */ ([command, found.get(macro.macro_id)?.[at]])),
    ),
  );
}
