// Plays the film on the figure. The robot stays still.

import { signal } from "../../html.js";
import { film, poseBefore } from "./current.js";
import { poseAt, totalOf } from "./lesson.js";

/** Seconds from the beginning, null while nothing is played. */
export const time = signal(/** @type {number | null} */ (null));

/** The pose of the figure in the preview, null without one. */
export const previewPose = () => (time.value === null ? null : poseAt(film.value, poseBefore(0), time.value));

/** Play the film from its beginning, or end that. */
export function togglePreview() {
  if (time.value !== null || film.value.length === 0) return endPreview();
  const begin = performance.now();
  time.value = 0;
  const tick = (/** @type {number} */ now) => {
    if (time.value === null) return;
    const next = Math.max(0, now - begin) / 1000;
    time.value = next < totalOf(film.value) ? next : null;
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

/** Show the robot itself again. */
export function endPreview() {
  time.value = null;
}
