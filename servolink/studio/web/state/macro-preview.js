// Plays a macro on the figure, and while something is held on the robot. Figure and playhead always show the same time.

import { effect, signal } from "../html.js";
import { poseAt } from "./macro-time.js";
import { pace } from "./motion.js";
import { actualPose } from "./robot.js";
import { course, macro, start } from "./shown-macro.js";

/** @typedef {import("./motion.js").Motion} Motion */
/** @typedef {import("./motion.js").Part} Part */
/** @typedef {import("./macro-time.js").Course} Course */

const NEAR = 2; // degrees from where the robot need not be brought to the pose of the preview
const SHORTEST = 0.1; // seconds

/** Seconds from the start of the macro. */
export const time = signal(0);
/** Whether the preview of the macro is playing on the figure. */
export const isPlaying = signal(false);
/** Whether the preview starts again at the end of the macro. */
export const isLooping = signal(false);
/** Whether the robot moves with the preview. */
export const isRunning = signal(false);

let shown = 0; // the macro to which the time belongs
effect(() => {
  const id = macro.value?.macro_id ?? 0;
  if (id !== shown) time.value = 0;
  shown = id;
});

const total = () => course.value?.seconds ?? 0;

/** The pose of the figure. */
export const pose = () => (course.value ? poseAt(course.value, start.value, time.value) : start.value);

/** Go on from the start at the end, or stay there. */
export function toggleLoop() {
  isLooping.value = !isLooping.value;
}

/** Pause the preview: its screen is left. */
export function pause() {
  isPlaying.value = false;
}

/** Play the preview, or pause it. The robot stays still. */
export function togglePlay() {
  if (isRunning.value) return;
  isPlaying.value = !isPlaying.value && total() > 0;
  if (!isPlaying.value) return;
  if (time.value >= total()) time.value = 0;
  let before = performance.now();
  const tick = (/** @type {number} */ now) => {
    if (!isPlaying.value) return;
    const next = time.value + Math.max(0, now - before) / 1000;
    before = now;
    if (next >= total() && !isLooping.value) isPlaying.value = false;
    time.value = next < total() ? next : isLooping.value ? 0 : total();
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

/**
 * Go to a moment and pause there.
 * @param {number} seconds
 */
export function seek(seconds) {
  if (isRunning.value) return;
  isPlaying.value = false;
  time.value = Math.max(0, Math.min(total(), seconds));
}

/**
 * Play on the robot from the present moment, as long as the control is held. First the robot moves to the pose of the preview.
 * @param {Motion} motion
 */
export async function runOnRobot(motion) {
  const whole = course.value;
  if (whole === null || whole.isCut || !(await motion.begin())) return;
  isPlaying.value = false;
  if (time.value >= whole.seconds) time.value = 0;
  const from = time.value,
    { parts, lead } = partsFrom(whole, from);
  isRunning.value = true;
  let sent = 0,
    sentAt = performance.now();
  const tick = () => {
    if (!isRunning.value) return;
    time.value = Math.min(whole.seconds, from + Math.max(0, sent + (performance.now() - sentAt) / 1000 - lead));
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
  await motion.play(parts, lead + whole.seconds - from, (at) => ([sent, sentAt] = [at, performance.now()]));
  isRunning.value = false;
}

/**
 * Return the movements of a course from a moment on, and how many seconds it takes to bring the robot there.
 * @param {Course} whole
 * @param {number} from
 * @returns {{ parts: Part[], lead: number }}
 */
export function partsFrom(whole, from) {
  const here = actualPose(),
    there = poseAt(whole, start.value, from);
  const moved = [...new Set(whole.turns.map((turn) => turn.servoId))];
  const away = moved.filter((id) => id in there && Math.abs((here[id] ?? there[id]) - there[id]) > NEAR);
  const lead = Math.max(0, ...away.map((id) => Math.max(SHORTEST, Math.abs((here[id] ?? 0) - there[id]) / pace.value)));
  /** @type {Map<string, Part>} */
  const parts = new Map();
  if (lead > 0)
    parts.set("lead", {
      at: 0,
      duration: lead,
      targets: Object.fromEntries(away.map((id) => [id, Math.round(there[id])])),
    });
  for (const { servoId, from: begins, until, end } of whole.turns) {
    if (until <= from && begins < from) continue;
    const at = lead + Math.max(0, begins - from),
      duration = Math.round((until - Math.max(begins, from)) * 100) / 100;
    const key = `${at.toFixed(4)} ${duration.toFixed(4)}`,
      part = parts.get(key) ?? { at, duration, targets: {} };
    part.targets[servoId] = end;
    parts.set(key, part);
  }
  return { parts: [...parts.values()].sort((a, b) => a.at - b.at), lead };
}
