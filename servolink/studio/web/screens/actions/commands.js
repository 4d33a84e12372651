// Commands of the user for the action on the screen as a whole.

import { withDegrees, withEnoughTime, withSteps, withTime } from "../../state/edit-action.js";
import { capOf, within } from "../../state/limits.js";
import { mirror, mirrored, rightToLeft } from "../../state/mirror.js";
import { draft, edit } from "../../state/project.js";
import { callersOf, withoutAction } from "../../state/records.js";
import { actualPose, servoIds } from "../../state/robot.js";
import { action, addAction, changeAction, ghostAction, nameOfAction, startPose } from "../../state/shown-action.js";
import { editToast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../state/motion.js").Part} Part */
/** @typedef {import("../../state/records.js").Action} Action */

const TIME = 500; // milliseconds of a new action

/** Add an action that is the pose of the robot now. */
export function addTaken() {
  const pose = actualPose(),
    number = (draft.value?.actions.length ?? 0) + 1;
  const steps = servoIds.value.map((servo_id) => ({
    servo_id,
    degree: within(servo_id, pose[servo_id] ?? 0),
    interval_ms: TIME,
  }));
  addAction("actions.did_add", t("actions.new_name", { number }), steps);
}

/** Add a copy. */
export function duplicate() {
  if (action.value === null) return;
  const { action_caption, steps } = action.value;
  addAction("actions.did_duplicate", t("actions.copy_of", { name: action_caption }), steps);
}

/** Delete the action, also where macros run it. */
export function remove() {
  const one = action.value,
    project = draft.value;
  if (one === null || project === null) return;
  const name = nameOfAction(one),
    callers = callersOf(project, "action", one.action_id);
  edit(["actions.did_delete", { name }], (before) => withoutAction(before, one.action_id));
  const detail = callers.length > 0 ? t("actions.deleted_from", { count: callers.length }) : "";
  editToast({ title: t("actions.deleted", { name }), detail });
}

/** Exchange left and right. */
export function mirrorAction() {
  if (mirror.value.size === 0) return;
  changeAction("actions.did_mirror", (one) => withSteps(one, mirrored(one.steps, mirror.value)));
  editToast({ icon: "mirror", title: t("actions.mirrored") });
}

/** Make the left half the image of the right half. */
export function copyRight() {
  changeAction("actions.did_copy", (one) => withSteps(one, rightToLeft(one.steps, mirror.value)));
}

/** Take the angles of the robot for the servos that take part, or for all if none does. */
export function take() {
  const pose = actualPose();
  changeAction("actions.did_take", (one) => {
    const ids = one.steps.length > 0 ? one.steps.map((step) => step.servo_id) : servoIds.value;
    return withDegrees(one, Object.fromEntries(ids.filter((id) => id in pose).map((id) => [id, Math.round(pose[id])])));
  });
}

/**
 * Give all servos the same time.
 * @param {number} seconds
 */
export const timeForAll = (seconds) => changeAction("actions.did_time_all", (one) => withTime(one, seconds * 1000));

/** Give servos above their cap as much time as necessary. */
export const moreTime = () =>
  changeAction("actions.did_more_time", (one) => withEnoughTime(one, startPose(ghostAction.value), capOf));

/**
 * Return the movements of an action from where the robot is, none faster than it may be.
 * @param {Action} one
 * @returns {{ parts: Part[], seconds: number }}
 */
export function trialOf(one) {
  const pose = actualPose();
  /** @type {Map<number, Record<number, number>>} */
  const byDuration = new Map();
  for (const { servo_id, degree, interval_ms } of one.steps) {
    const needed = Math.abs(degree - (pose[servo_id] ?? degree)) / capOf(servo_id);
    const duration = Math.max(interval_ms / 1000, Math.ceil(needed * 100) / 100);
    byDuration.set(duration, { ...byDuration.get(duration), [servo_id]: degree });
  }
  const parts = [...byDuration].map(([duration, targets]) => ({ at: 0, duration, targets }));
  return { parts, seconds: Math.max(0, ...byDuration.keys()) };
}
