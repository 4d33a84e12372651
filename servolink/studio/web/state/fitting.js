// Fit of a figure to a robot: the part that each servo turns, with direction and zero.

import { signal } from "../html.js";
import { figure, ownFigure, templates } from "./figure.js";
import { servoIds } from "./robot.js";

/** @typedef {import("../figure/figure.js").FigureData} FigureData */
/** @typedef {import("../figure/figure.js").JointData} JointData */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** Figure to save, and the joints for servos. @typedef {{ data: FigureData, parts: string[] }} Fit */
/** @typedef {Partial<Pick<JointData, "sign" | "offset" | "limits">>} Change */

/** The figure that is being fitted, null for none. */
export const fit = signal(/** @type {Fit | null} */ (null));
/** Servo of the current question. */
export const asked = signal(0);
/** Index of the template at the beginning of the fit; -1 for the figure of the robot. */
export const origin = signal(0);

/** Begin with the figure as it is, or with a template if there is none. */
export function beginFit() {
  const count = servoIds.value.length;
  const closest = templates.value.map(({ servoIds: ids }) => Math.abs(ids.length - count));
  askAbout(servoIds.value[0] ?? 0);
  fitFrom(figure.value ? -1 : closest.indexOf(Math.min(...closest)));
}

/**
 * Begin again with a template.
 * @param {number} number of the template, -1 for the figure as it was
 */
export function fitFrom(number) {
  origin.value = number;
  const from = number < 0 ? figure.value : templates.value[number];
  if (from) fit.value = begin(from.data, servoIds.value);
}

/** @param {Fit} next */
export function changeFit(next) {
  fit.value = next;
}

/** End the fit: it was saved, or is not wanted any more. */
export function endFit() {
  fit.value = null;
}

/** @param {number} servo */
export function askAbout(servo) {
  asked.value = servo;
}

/** Return the name of the figure. */
export const nameOfFit = () =>
  (origin.value < 0 ? ownFigure.value?.name : templates.value[origin.value].data.name) ?? figure.value?.data.name ?? "";

/**
 * Begin to fit a figure: joints with a servo can get another servo. Servos absent from the robot are removed.
 * @param {FigureData} data
 * @param {number[]} servoIds of the robot
 * @returns {Fit}
 */
export function begin(data, servoIds) {
  const parts = data.joints.filter((joint) => joint.servo !== undefined).map((joint) => joint.id);
  const joints = data.joints.map((joint) => (servoIds.includes(joint.servo ?? -1) ? joint : without(joint)));
  return { data: { ...data, joints: followed({ ...data, joints }, data) }, parts };
}

/**
 * Return the joint that a servo turns, or null.
 * @param {Fit} fit
 * @param {number} servo
 */
export const jointOf = (fit, servo) => fit.data.joints.find((joint) => joint.servo === servo) ?? null;

/**
 * Assign a joint to a servo, null for none. The servo that had the joint gets the old joint of this servo.
 * @param {Fit} fit
 * @param {number} servo
 * @param {string | null} id of the joint
 * @returns {Fit}
 */
export function assigned(fit, servo, id) {
  const left = jointOf(fit, servo),
    taken = fit.data.joints.find((joint) => joint.id === id);
  const joints = fit.data.joints.map((joint) => {
    if (joint === taken) return { ...joint, servo };
    if (joint !== left) return joint;
    return taken?.servo === undefined ? without(joint) : { ...joint, servo: taken.servo };
  });
  return { ...fit, data: { ...fit.data, joints: followed({ ...fit.data, joints }, fit.data) } };
}

/**
 * Change how a joint turns.
 * @param {Fit} fit
 * @param {string} id
 * @param {Change} change
 * @returns {Fit}
 */
export const changed = (fit, id, change) => ({
  ...fit,
  data: { ...fit.data, joints: fit.data.joints.map((joint) => (joint.id === id ? { ...joint, ...change } : joint)) },
});

/**
 * Return the figure for drawing during a fit: parts without a servo can be picked too, because the number of each joint
 * stands in place of a servo.
 * @param {Fit} fit
 * @returns {FigureData}
 */
export function drawn({ data, parts }) {
  const numberOf = new Map(
    data.joints.flatMap((joint, number) => (joint.servo === undefined ? [] : [[joint.servo, number]])),
  );
  const joints = data.joints.map((joint, number) => ({
    ...joint,
    servo: parts.includes(joint.id) ? number : undefined,
    follows: joint.follows === undefined ? undefined : numberOf.get(joint.follows),
  }));
  return { ...data, joints };
}

/**
 * Return a pose of the robot as a pose of the drawn figure.
 * @param {Fit} fit
 * @param {Pose} pose
 * @returns {Pose}
 */
export const drawnPose = ({ data }, pose) =>
  Object.fromEntries(
    data.joints.flatMap(({ servo }, number) => (servo === undefined ? [] : [[number, pose[servo] ?? 0]])),
  );

/** @param {JointData} joint */
function without(joint) {
  const { servo: _, ...rest } = joint;
  return rest;
}

/**
 * Return the joints of a figure. Joints keep following another joint, also after a change of its servo.
 * @param {FigureData} data
 * @param {FigureData} before
 * @returns {JointData[]}
 */
function followed(data, before) {
  return data.joints.map((joint) => {
    if (joint.follows === undefined) return joint;
    const leader = before.joints.findIndex((each) => each.servo === joint.follows);
    const servo = data.joints[leader]?.servo;
    if (servo !== undefined) return { ...joint, follows: servo };
    const { follows: _, ...rest } = joint;
    return rest;
  });
}
