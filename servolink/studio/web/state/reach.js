// Hands, feet and head that are dragged to a place: the studio computes the angles of all joints that lead there.

import { effect, signal } from "../html.js";
import { figure } from "./figure.js";
import { hasTwin } from "./twin.js";

/** @typedef {import("../figure/matrix.js").Vector} Vector */
/** @typedef {import("./records.js").Pose} Pose */
/** @typedef {{ joint: string, move: Vector, start: Pose }} Drag Way of the tip of a joint, in the frame of the base. */
/** @typedef {{ angles: Pose, missed_mm: number }} Reached */

/** Whether a drag moves a whole limb, and not one servo. */
export const dragsLimb = signal(true);
/** Millimetres between the dragged part and its place; 0 for a place that was reached. */
export const missed = signal(0);

/** @type {import("../link/link.js").Link | null} */
let link = null;
/** Latest drag that was not asked for yet. @type {Drag | null} */
let next = null;
let isAsking = false,
  isDragging = false;

/**
 * Ask for poses over a connection, from now on.
 * @param {import("../link/link.js").Link} connected
 */
export function followReach(connected) {
  link = connected;
  effect(() => void (figure.value, endReach()));
}

/** Whether the studio computes poses for dragged limbs. */
export const canReach = () => hasTwin.value === true && dragsLimb.value;

/** Let a drag move a whole limb, or one servo. */
export function toggleLimb() {
  dragsLimb.value = !dragsLimb.value;
}

/**
 * Ask for the pose of a drag; of several drags, only for the latest.
 * @param {Drag} drag
 * @param {(angles: Pose) => void} onReached
 */
export async function reach(drag, onReached) {
  next = drag;
  isDragging = true;
  const asked = link;
  if (isAsking || asked === null) return;
  isAsking = true;
  while (next !== null && figure.value !== null) {
    const params = { figure: figure.value.data, ...next };
    next = null;
    /** @type {Reached | null} */
    const answer = await asked.call("studio.twin.reach", params).catch(() => null);
    if (answer === null || !isDragging) break;
    missed.value = answer.missed_mm;
    onReached(answer.angles);
  }
  isAsking = false;
}

/** End a drag: later answers change nothing. */
export function endReach() {
  next = null;
  isDragging = false;
  missed.value = 0;
}
