// Movement of the robot as seen on the screen Live, to become a macro (`project.thin`).

import { effect, signal } from "../html.js";
import { LENGTH } from "./history.js";
import { history, isLive, readAt, servoIds } from "./robot.js";

/** Readings of the servos at ascending times in seconds. @typedef {{ times: number[], angles: Record<number, number[]> }} Seen */

/** Number of readings before the recording; null while nothing is recorded. */
export const begunAt = signal(/** @type {number | null} */ (null));
/** Movement recorded last; null without one. */
export const seen = signal(/** @type {Seen | null} */ (null));

export function beginSeeing() {
  seen.value = null;
  begunAt.value = history.count;
}

/** End the recording, and keep its readings. */
export function endSeeing() {
  if (begunAt.value === null) return;
  seen.value = readingsFrom(begunAt.value);
  begunAt.value = null;
}

export function forgetSeen() {
  seen.value = null;
}

effect(() => {
  const isFull = readAt.value > 0 && history.count - (begunAt.value ?? Infinity) >= LENGTH;
  if (begunAt.value !== null && (isFull || !isLive.value)) endSeeing();
});

/**
 * Return the readings from a number on, with the reading before in place of a doubtful reading.
 * @param {number} begin
 * @returns {Seen}
 */
function readingsFrom(begin) {
  const places = /** @type {number[]} */ ([]);
  for (let count = Math.max(begin, history.count - LENGTH); count < history.count; count++) {
    const at = count % LENGTH;
    if (places.length === 0 || history.times[at] > history.times[/** @type {number} */ (places.at(-1))])
      places.push(at);
  }
  const angles = servoIds.value.map((id) => {
    const ring = history.of(id).angle;
    let last = places.map((at) => ring[at]).find((angle) => !Number.isNaN(angle)) ?? 0;
    return [id, places.map((at) => (last = Number.isNaN(ring[at]) ? last : ring[at]))];
  });
  return { times: places.map((at) => history.times[at]), angles: Object.fromEntries(angles) };
}
