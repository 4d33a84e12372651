// Timeline of a macro on the screen: lanes, width, and the clip under the pointer.

import { computed, signal } from "../html.js";
import { course } from "./shown-macro.js";

const SHORTEST = 1; // seconds
const TARGET = 24; // pixels of what a finger or a mouse can hit
const GAP = 2; // pixels between two targets
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

/** Width of the lane of clips, pixels. */
const width = signal(0);

/** @typedef {import("./macro-time.js").Clip} Clip */
/** Numbers below clips that are too short to hit: middle of the clip and of the number by index, pixels. @typedef {Map<number, { from: number, to: number }>} Handles */
let handlesBefore = /** @type {Handles} */ (new Map());

/** Numbers below the short clips of the macro itself; the same while a clip is stretched. */
export const handles = computed(() => {
  if (frozen.value !== null || width.value === 0) return handlesBefore;
  const perSecond = width.value / span.value;
  const short = clipsOf(course.value).filter((clip) => (clip.until - clip.from) * perSecond - GAP < TARGET);
  const middles = short.map((clip) => ((clip.from + clip.until) / 2) * perSecond);
  const places = apart(middles, TARGET + GAP, width.value);
  return (handlesBefore = new Map(short.map((clip, at) => [clip.index, { from: middles[at], to: places[at] }])));
});

/** Least width of the lane of clips, in which a number below each clip has room, pixels. */
export const leastWidth = computed(() => clipsOf(course.value).length * (TARGET + GAP));

/** @param {import("./macro-time.js").Course | null} course */
const clipsOf = (course) => (course?.clips ?? []).filter((clip) => clip.depth === 0);

/**
 * Return places at least `least` apart, and half of that from both ends, as near the wishes as possible.
 * @param {readonly number[]} wishes in ascending order
 * @param {number} least
 * @param {number} width with room for all
 * @returns {number[]}
 */
export function apart(wishes, least, width) {
  /** Wishes that share a row of places, each less the room of the places before. @type {{ sum: number, count: number }[]} */
  const rows = [];
  for (const [at, wish] of wishes.entries()) {
    let row = { sum: wish - at * least, count: 1 };
    for (let last = rows.at(-1); last && last.sum / last.count > row.sum / row.count; last = rows.at(-1)) {
      rows.pop();
      row = { sum: last.sum + row.sum, count: last.count + row.count };
    }
    rows.push(row);
  }
  const lowest = least / 2,
    highest = width - (wishes.length - 0.5) * least;
  return rows
    .flatMap(({ sum, count }) => Array(count).fill(Math.max(lowest, Math.min(highest, sum / count))))
    .map((place, at) => place + at * least);
}

/** @param {number} pixels of the lane of clips */
export function measureLane(pixels) {
  width.value = pixels;
}

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
