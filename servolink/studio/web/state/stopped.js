// Stopped servos: a stopped servo holds its angle, and moves only after a new start.

import { effect, signal } from "../html.js";
import { readAt, servos } from "./robot.js";

const SETTLES = 400; // milliseconds: limp servos are held before they are started

/** Number of stopped servos among the held servos. */
export const stoppedCount = signal(0);
/** Whether all servos that hold are stopped. */
export const isAllStopped = signal(false);

let since = Infinity; // milliseconds of `performance.now()`

effect(() => {
  const held = [...servos.value.values()].filter((servo) => servo.is_hold);
  const count = held.filter((servo) => !servo.is_start).length;
  since = count === 0 ? Infinity : Math.min(since, readAt.value);
  if (count > 0 && readAt.value - since < SETTLES) return;
  stoppedCount.value = count;
  isAllStopped.value = count === held.length;
});
