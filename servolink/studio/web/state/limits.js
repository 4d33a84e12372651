// Limits of servos from the profile of the board: highest speeds, angles, and the unit of intervals.

import { computed } from "../html.js";
import { limitsOf } from "./figure.js";
import { welcome } from "./robot.js";

const USUAL_CAP = 240; // degrees per second: what small servos with a load reach; only warned of
const UNIT = 0.01; // seconds, of an interval of 1 in the document

/** @typedef {{ speed_cap?: number | null, speed_caps?: Record<string, number>, angles?: Record<string, [number, number]> }} Limits */

const limits = computed(() => /** @type {Limits} */ (welcome.value?.profile?.limits ?? {}));

/** Factor between measured and stored durations of movements on the board. */
export const slowness = computed(() => (welcome.value?.profile?.settings?.interval_unit ?? UNIT) / UNIT);

/**
 * Return the highest speed of a servo, degrees per second: of the profile, or a usual one.
 * @param {number} servoId
 */
export function capOf(servoId) {
  const { speed_cap, speed_caps = {} } = limits.value;
  return Math.min(speed_cap ?? USUAL_CAP, speed_caps[servoId] ?? Infinity);
}

/**
 * Return an angle within what figure and profile allow a servo.
 * @param {number} servoId
 * @param {number} degree
 */
export function within(servoId, degree) {
  const [low, high] = limitsOf(servoId),
    [lowest, highest] = limits.value.angles?.[servoId] ?? [low, high];
  return Math.max(low, lowest, Math.min(high, highest, Math.round(degree)));
}
