// Timeline of a macro on the screen: lanes, width, and the clip under the pointer.

import { computed, signal } from "../html.js";
import { course } from "./shown-macro.js";

const SHORTEST = 1; // seconds
const ROOM = 1.06;
const FARTHEST = 1,
  NEAREST = 8,
  BY = 2;

/** Kind of rows that have a lane each. */
export const lanes = signal(/** @type {"servos" | "limbs"} */ ("servos"));
/** Width of the timeline in widths of the screen. */
export const zoom = signal(FARTHEST);
/** Whether the time axis cannot be enlarged further. */
export const isNearest = computed(() => zoom.value >= NEAREST);
/** Whether the time axis cannot be reduced further. */
export const isFarthest = computed(() => zoom.value <= FARTHEST);
/** Clip under the pointer, and its index if it is dropped now; null without a drag. */
export const dragged = signal(/** @type {{ index: number, to: number } | null} */ (null));

/** The seconds of the timeline while a clip is stretched, so that nothing runs away from the pointer. */
const frozen = signal(/** @type {number | null} */ (null));

/** The seconds of the timeline from left to right. */
export const span = computed(() => frozen.value ?? Math.max(SHORTEST, (course.value?.seconds ?? 0) * ROOM));

/** @param {typeof lanes.value} name */
export function showLanes(name) {
  lanes.value = name;
}

/** Enlarge the time axis by one step. */
export function zoomIn() {
  zoom.value *= BY;
}

/** Reduce the time axis by one step. */
export function zoomOut() {
  zoom.value /= BY;
}

/** Keep the width of a second until `releaseScale` is called. */
export function freezeScale() {
  frozen.value = span.value;
}

export function releaseScale() {
  frozen.value = null;
}

/**
 * Drag a clip to another place.
 * @param {number} index of the clip
 * @param {number} to its index if it is dropped now
 */
export function dragClip(index, to) {
  if (dragged.value?.to !== to) dragged.value = { index, to };
}

/** End the drag. Return the clip and its new place, null if none was dragged. */
export function endDrag() {
  const last = dragged.value;
  dragged.value = null;
  return last;
}

/**
 * Return a moment as a share of the timeline.
 * @param {number} seconds
 */
export const share = (seconds) => `${((seconds / span.value) * 100).toFixed(3)}%`;

/**
 * Return place and width of an interval on the timeline.
 * @param {{ from: number, until: number }} what
 */
export const place = ({ from, until }) => ({
  left: share(from),
  width: `max(3px, calc(${share(until - from)} - 2px))`,
});
