// Action on the screen, its first pose, and changes of both.

import { computed, signal } from "../html.js";
import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { focusNext } from "./focus.js";
import { draft, edit } from "./project.js";
import { fitCaption, freeId, poseOf, withRecord } from "./records.js";
import { actualPose } from "./robot.js";
import { chooseAction, chosenAction } from "./view.js";

/** @typedef {import("./records.js").Action} Action */
/** @typedef {import("./records.js").Pose} Pose */
/** @typedef {import("./undo.js").Label} Label */

/** Chosen action; the first action if the chosen one is gone, null without actions. */
export const action = computed(() => {
  const actions = draft.value?.actions ?? [];
  return actions.find((one) => one.action_id === chosenAction.value) ?? actions[0] ?? null;
});

/** Pose before the action: of another action, of the robot, or of the action that usually comes before. */
export const ghostChoice = signal(/** @type {number | "robot" | "before"} */ ("before"));
/** Whether the stage shows the previous pose as a ghost. */
export const showsGhost = signal(true);
/** Text that the actions of the list contain; empty for all. */
export const searchText = signal("");

/** @param {typeof ghostChoice.value} choice */
export function chooseGhost(choice) {
  ghostChoice.value = choice;
}

/** Show the pose before the action, or hide it. */
export function toggleGhost() {
  showsGhost.value = !showsGhost.value;
}

/** @param {string} text */
export function searchActions(text) {
  searchText.value = text;
}

/** The action from which the ghost is taken; null for the robot itself. */
export const ghostAction = computed(() => {
  const choice = ghostChoice.value,
    actions = draft.value?.actions ?? [];
  if (choice === "robot" || action.value === null) return null;
  if (choice === "before") return actionBefore(action.value);
  return actions.find((one) => one.action_id === choice) ?? null;
});

/**
 * Return the action before another action: in a macro, or else in the list.
 * @param {Action} one
 */
export function actionBefore(one) {
  const { actions = [], macros = [] } = draft.value ?? {};
  const runs = macros.map((macro) =>
    macro.commands.filter((command) => command.type === "action").map((command) => command.action_id),
  );
  for (const ids of runs) {
    const at = ids.findIndex((id, index) => id === one.action_id && index > 0 && ids[index - 1] !== id);
    const found = at < 0 ? undefined : actions.find((other) => other.action_id === ids[at - 1]);
    if (found) return found;
  }
  return actions[actions.indexOf(one) - 1] ?? null;
}

/**
 * Return the known part of the pose before an action.
 * @param {Action | null} from null for the robot itself
 * @returns {Pose}
 */
export const startPose = (from) => (from === null ? actualPose() : poseOf(from));

/**
 * Return the name of an action, for people.
 * @param {Action} one
 */
export const nameOfAction = (one) => safeText(one.action_caption) || t("actions.unnamed", { id: one.action_id });

/**
 * Change the action on the screen.
 * @param {Label[0]} key of the text of the undo button
 * @param {(action: Action) => Action} change
 * @param {{ values?: Record<string, string | number>, merge?: string }} [options]
 */
export function changeAction(key, change, { values = {}, merge = "" } = {}) {
  const one = action.value;
  if (one === null) return;
  const after = change(one);
  if (after === one) return;
  edit(
    [key, { name: nameOfAction(one), ...values }],
    (project) => withRecord(project, "actions", after),
    merge && `${merge} ${one.action_id}`,
  );
}

/**
 * Add an action, show it, and let its name be typed.
 * @param {Label[0]} key
 * @param {string} caption
 * @param {Action["steps"]} steps
 */
export function addAction(key, caption, steps) {
  focusNext("name");
  edit([key, { name: safeText(caption) }], (project) => {
    const action_id = freeId("actions", project);
    chooseAction(action_id);
    return withRecord(project, "actions", { action_id, action_caption: fitCaption(caption), steps });
  });
}
