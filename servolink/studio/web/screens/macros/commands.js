// Commands of the user for the chosen command of a macro, and for the macro as a whole.

import { withCommand, withCommandAt, withMoved, withoutCommandAt } from "../../state/edit-macro.js";
import { focusNext } from "../../state/focus.js";
import { draft, edit } from "../../state/project.js";
import { callersOf, withoutMacro } from "../../state/records.js";
import {
  addMacro,
  changeMacro,
  chooseClip,
  chosenClip,
  macro,
  nameOfCommand,
  nameOfMacro,
} from "../../state/shown-macro.js";
import { editToast } from "../../state/toasts.js";
import { seconds, t } from "../../texts/text.js";

/** Slowest and fastest speed of a command in percent. */
export const SLOWEST = 1,
  FASTEST = 100; // percent
/** Most repeats of a command on the board. */
export const MOST_REPEATS = 32_767;
const UNIT = 10; // milliseconds

/** Return the chosen command, null if there is none. */
export const chosenCommand = () =>
  chosenClip.value === null ? null : (macro.value?.commands[chosenClip.value] ?? null);

/** Duplicate the chosen command, or the macro if none is chosen. */
export function duplicate() {
  const one = macro.value,
    command = chosenCommand(),
    at = chosenClip.value;
  if (one === null) return;
  if (command === null || at === null) return duplicateMacro();
  changeMacro("macros.did_insert", (each) => withCommandAt(each, at + 1, { ...command }), {
    values: { what: nameOfCommand(command) },
  });
  focusNext("clip");
  chooseClip(at + 1);
}

/** Duplicate the macro on the screen. */
export function duplicateMacro() {
  const one = macro.value;
  if (one !== null) addMacro("macros.did_duplicate", t("actions.copy_of", { name: one.macro_caption }), one.commands);
}

/** Take the chosen command out of the macro. */
export function removeChosen() {
  const command = chosenCommand(),
    at = chosenClip.value;
  if (command === null || at === null) return;
  changeMacro("macros.did_remove", (each) => withoutCommandAt(each, at), { values: { what: nameOfCommand(command) } });
  focusNext("clip");
  chooseClip(at > 0 ? at - 1 : null);
}

/**
 * Move a command to another place, and choose it.
 * @param {number} from
 * @param {number} to
 */
export function move(from, to) {
  const one = macro.value;
  if (one === null || from === to || to < 0 || to >= one.commands.length) return;
  changeMacro("macros.did_move", (each) => withMoved(each, from, to), {
    values: { what: nameOfCommand(one.commands[from]) },
  });
  chooseClip(to);
}

/**
 * Move the chosen command one place.
 * @param {1 | -1} way
 */
export function moveChosen(way) {
  if (chosenClip.value !== null) move(chosenClip.value, chosenClip.value + way);
}

/**
 * Set the speed of a command, percent.
 * @param {number} at
 * @param {number} percent
 * @param {string} [merge]
 */
export function setSpeed(at, percent, merge = "") {
  const command = macro.value?.commands[at],
    ratio = Math.max(SLOWEST, Math.min(FASTEST, Math.round(percent)));
  if (!command || command.ratio_percent === ratio) return;
  const values = { what: nameOfCommand(command), ratio };
  changeMacro("macros.did_speed", (each) => withCommand(each, at, { ratio_percent: ratio }), {
    values,
    merge: merge && `${merge} ${at}`,
  });
}

/**
 * Set how often a command is run.
 * @param {number} at
 * @param {number} loop
 */
export function setRepeats(at, loop) {
  const command = macro.value?.commands[at],
    count = Math.round(loop);
  if (command)
    changeMacro("macros.did_repeat", (each) => withCommand(each, at, { loop: count }), {
      values: { what: nameOfCommand(command), count },
    });
}

/**
 * Set how long a pause is, to the next 10 ms.
 * @param {number} at
 * @param {number} milliseconds
 * @param {string} [merge]
 */
export function setPause(at, milliseconds, merge = "") {
  const delay_ms = Math.max(0, Math.round(milliseconds / UNIT) * UNIT);
  if (macro.value?.commands[at]?.delay_ms === delay_ms) return;
  const values = { time: seconds(delay_ms / 1000) };
  changeMacro("macros.did_wait", (each) => withCommand(each, at, { delay_ms }), {
    values,
    merge: merge && `${merge} ${at}`,
  });
}

/**
 * Set the duration of a command: the length of a pause, the speed of any other command.
 * @param {number} at
 * @param {{ from: number, until: number }} clip as it was when the drag began
 * @param {import("../../state/records.js").Command} command as it was then
 * @param {number} wanted seconds
 */
export function stretch(at, clip, command, wanted) {
  const length = Math.max(UNIT / 1000, Math.round(wanted * (1000 / UNIT)) / (1000 / UNIT));
  if (command.type === "delay")
    setPause(at, (length * 1000 * command.ratio_percent) / 100 / Math.max(1, command.loop), "stretch");
  else setSpeed(at, ((clip.until - clip.from) * command.ratio_percent) / length, "stretch");
}

/** Delete the macro, also where other macros or buttons start it. */
export function removeMacro() {
  const one = macro.value,
    project = draft.value;
  if (one === null || project === null) return;
  const name = nameOfMacro(one),
    id = one.macro_id;
  const starts = project.joystick_tables.flatMap((table) =>
    table.buttons.flatMap((button) => [
      button.button_press_macro,
      button.button_long_press_macro,
      button.button_up_macro,
    ]),
  );
  const isUsed = callersOf(project, "macro", id).length > 0 || starts.includes(id);
  edit(["macros.did_delete", { name }], (before) => withoutMacro(before, id));
  chooseClip(null);
  editToast({ title: t("macros.deleted", { name }), detail: isUsed ? t("macros.deleted_from") : "" });
}
