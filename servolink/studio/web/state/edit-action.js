// Changes of actions: each function takes an action and returns another one.

import { LONGEST } from "./records.js";

/** @typedef {import("./records.js").Action} Action */
/** @typedef {import("./records.js").Step} Step */
/** @typedef {import("./records.js").Pose} Pose */
/** @typedef {(servoId: number) => number} CapOf highest speed of a servo, degrees per second */

/** Shortest time that the board counts in a step. */
export const UNIT = 10; // milliseconds
const USUAL = 500; // milliseconds of a first step

/**
 * Return the action with the steps of `changes` changed or added.
 * @param {Action} action
 * @param {Pose} degrees
 * @returns {Action}
 */
export function withDegrees(action, degrees) {
  const interval_ms = Math.max(0, ...action.steps.map((step) => step.interval_ms)) || USUAL;
  const changed = action.steps.map((step) =>
    step.servo_id in degrees ? { ...step, degree: degrees[step.servo_id] } : step,
  );
  const known = new Set(action.steps.map((step) => step.servo_id));
  const added = Object.keys(degrees)
    .map(Number)
    .filter((id) => !known.has(id));
  return withSteps(action, [
    ...changed,
    ...added.map((servo_id) => ({ servo_id, degree: degrees[servo_id], interval_ms })),
  ]);
}

/**
 * Return the action with these steps, in the order of the servos.
 * @param {Action} action
 * @param {readonly Step[]} steps
 * @returns {Action}
 */
export const withSteps = (action, steps) => ({ ...action, steps: [...steps].sort((a, b) => a.servo_id - b.servo_id) });

/**
 * Return the action without the steps of a servo.
 * @param {Action} action
 * @param {number} servoId
 * @returns {Action}
 */
export const withoutServo = (action, servoId) => ({
  ...action,
  steps: action.steps.filter((step) => step.servo_id !== servoId),
});

/**
 * Return the action with another time for one servo, or for all.
 * @param {Action} action
 * @param {number} milliseconds
 * @param {number} [servoId]
 * @returns {Action}
 */
export function withTime(action, milliseconds, servoId) {
  const interval_ms = Math.max(0, Math.min(LONGEST, Math.round(milliseconds / UNIT) * UNIT));
  return {
    ...action,
    steps: action.steps.map((step) =>
      servoId === undefined || step.servo_id === servoId ? { ...step, interval_ms } : step,
    ),
  };
}

/**
 * Return how fast each servo turns from a pose, degrees per second; servos of an unknown angle are left out.
 * @param {Action} action
 * @param {Pose} start
 * @returns {Map<number, number>}
 */
export function speedsOf(action, start) {
  return new Map(
    action.steps
      .filter((step) => step.servo_id in start)
      .map((step) => {
        const way = Math.abs(step.degree - start[step.servo_id]);
        return [step.servo_id, way === 0 ? 0 : way / (step.interval_ms / 1000)];
      }),
  );
}

/**
 * Return the servos that an action turns faster than they may, with their speeds.
 * @param {Action} action
 * @param {Pose} start
 * @param {CapOf} capOf
 */
export const tooFast = (action, start, capOf) =>
  [...speedsOf(action, start)].filter(([id, speed]) => speed > capOf(id));

/**
 * Return the action with as much time for each servo as it needs from a pose, to the next 10 ms.
 * @param {Action} action
 * @param {Pose} start
 * @param {CapOf} capOf
 * @returns {Action}
 */
export function withEnoughTime(action, start, capOf) {
  const needed = new Map(tooFast(action, start, capOf));
  /** @param {Step} step */
  const slower = (step) => {
    const seconds = Math.abs(step.degree - start[step.servo_id]) / capOf(step.servo_id);
    return { ...step, interval_ms: Math.min(LONGEST, Math.ceil((seconds * 1000) / UNIT - 1e-9) * UNIT) };
  };
  return { ...action, steps: action.steps.map((step) => (needed.has(step.servo_id) ? slower(step) : step)) };
}
