// Macro on the screen: chosen command, course in time, and changes of the record.

import { computed, effect, signal } from "../html.js";
import { safeText } from "../parts/safe-text.js";
import { seconds, t } from "../texts/text.js";
import { macroSeconds } from "./durations.js";
import { commandOf, withCommandAt } from "./edit-macro.js";
import { focusNext } from "./focus.js";
import { capOf, slowness } from "./limits.js";
import { courseOf, speedOf } from "./macro-time.js";
import { draft, edit } from "./project.js";
import { fitCaption, freeId, targetOf, withRecord } from "./records.js";
import { actualPose } from "./robot.js";
import { chooseMacro, chosenMacro } from "./view.js";

/** @typedef {import("./records.js").Macro} Macro */
/** @typedef {import("./records.js").Command} Command */
/** @typedef {import("./records.js").Pose} Pose */
/** @typedef {import("./undo.js").Label} Label */

/** Chosen macro; the first macro if the chosen one is gone, null without macros. */
export const macro = computed(() => {
  const macros = draft.value?.macros ?? [];
  return macros.find((one) => one.macro_id === chosenMacro.value) ?? macros[0] ?? null;
});

/** Index of the chosen command; null for the macro as a whole. */
export const chosenClip = signal(/** @type {number | null} */ (null));

const shown = computed(() => macro.value?.macro_id);
effect(() => {
  if (shown.value !== undefined) chooseClip(null); // also when another page deletes the macro
});

/**
 * Choose a command of the macro on the screen.
 * @param {number | null} index null for the macro as a whole
 */
export function chooseClip(index) {
  chosenClip.value = index;
}

/**
 * Show a macro as a whole.
 * @param {number} id
 */
export function showMacro(id) {
  chooseMacro(id);
  chooseClip(null);
}

/** Pose from which the preview starts: that of the robot when the screen was opened. */
export const start = signal(/** @type {Pose} */ ({}));

/** Let the preview start where the robot is now. */
export function startFromRobot() {
  start.value = actualPose();
}

/** Course of the macro in time; null if it never ends. */
export const course = computed(() =>
  draft.value && macro.value ? courseOf(draft.value, macro.value.macro_id, start.value, slowness.value) : null,
);
/** The turns that are faster than the servos may be. */
export const fastTurns = computed(() =>
  (course.value?.turns ?? []).filter((turn) => speedOf(turn) > capOf(turn.servoId)),
);

const lasts = computed(() => (draft.value ? macroSeconds(draft.value) : new Map()));

/**
 * Return how long a macro takes as the board counts, seconds; null if it never ends.
 * @param {Macro} one
 */
export const secondsOfMacro = (one) => lasts.value.get(one.macro_id) ?? null;

/** @param {Macro} one */
export const nameOfMacro = (one) => safeText(one.macro_caption) || t("macros.unnamed", { id: one.macro_id });

/**
 * Return the name of a command, for people.
 * @param {Command} command
 */
export function nameOfCommand(command) {
  if (command.type === "delay") return t("macros.pause");
  const id = targetOf(command);
  const action = command.type === "action" && draft.value?.actions.find((one) => one.action_id === id);
  if (action) return safeText(action.action_caption) || t("actions.unnamed", { id });
  const called = command.type === "macro" && draft.value?.macros.find((one) => one.macro_id === id);
  return called ? nameOfMacro(called) : t("macros.unnamed_clip");
}

/**
 * Change the macro on the screen.
 * @param {Label[0]} key of the text of the undo button
 * @param {(macro: Macro) => Macro} change
 * @param {{ values?: Record<string, string | number>, merge?: string }} [options]
 */
export function changeMacro(key, change, { values = {}, merge = "" } = {}) {
  const one = macro.value;
  if (one === null) return;
  const label = /** @type {Label} */ ([key, { name: nameOfMacro(one), ...values }]);
  edit(label, (project) => withRecord(project, "macros", change(one)), merge && `${merge} ${one.macro_id}`);
}

/**
 * Add a macro, show it, and let its name be typed.
 * @param {Label[0]} key
 * @param {string} caption
 * @param {readonly Command[]} commands
 */
export function addMacro(key, caption, commands) {
  focusNext("name");
  edit([key, { name: safeText(caption) }], (project) => {
    const macro_id = freeId("macros", project);
    chooseMacro(macro_id);
    return withRecord(project, "macros", { macro_id, macro_caption: fitCaption(caption), commands });
  });
  chooseClip(null);
}

/** Add an empty macro. */
export const addEmptyMacro = () =>
  addMacro("macros.did_add", t("macros.new_name", { number: (draft.value?.macros.length ?? 0) + 1 }), []);

/**
 * Insert a command after the chosen command, or at the end, and choose the new command.
 * @param {"action" | "macro" | "delay"} type
 * @param {number} value id, or milliseconds
 */
export function insertCommand(type, value) {
  const one = macro.value;
  if (one === null) return;
  const at = chosenClip.value === null ? one.commands.length : Math.min(chosenClip.value + 1, one.commands.length);
  const command = commandOf(type, value);
  const what = type === "delay" ? seconds(value / 1000) : nameOfCommand(command);
  changeMacro("macros.did_insert", (each) => withCommandAt(each, at, command), { values: { what } });
  focusNext("clip");
  chooseClip(at);
}
