// How the timeline is shown, and how wide a second is. It stays while something is dragged, so that nothing runs away from the pointer.

import { computed, signal } from "../../html.js";
import { course } from "./current.js";

const SHORTEST = 1; // seconds
const ROOM = 1.06;

/** What has a lane of its own. */
export const lanes = signal(/** @type {"servos" | "limbs"} */ ("servos"));
/** How many times wider than the screen the timeline is. */
export const zoom = signal(1);

/** The seconds of the timeline while something is dragged. */
export const frozen = signal(/** @type {number | null} */ (null));

/** The seconds of the timeline from left to right. */
export const span = computed(() => frozen.value ?? Math.max(SHORTEST, (course.value?.seconds ?? 0) * ROOM));

/**
 * Return a moment as a share of the timeline.
 * @param {number} seconds
 */
export const share = (seconds) => `${((seconds / span.value) * 100).toFixed(3)}%`;

/**
 * Return place and width of what lasts from one moment to another.
 * @param {{ from: number, until: number }} what
 */
export const place = ({ from, until }) => ({
  left: share(from),
  width: `max(3px, calc(${share(until - from)} - 2px))`,
});
