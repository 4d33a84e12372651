// Easing of a movement: actions in a row that follow a curve within a stated error, as the board itself moves servos
// steadily from one pose to the next.

/** @typedef {import("./records.js").Step} Step */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** @typedef {"linear" | "soft" | "snap"} Curve */
/** Steps of each action, and the largest distance from the curve in degrees. @typedef {{ parts: Step[][], worst: number }} Eased */

const UNIT = 10; // milliseconds, as the board counts them
const ROUNDING = 0.5; // degrees: the board takes whole ones
const ACTION_BYTES = 38,
  STEP_BYTES = 5,
  MACRO_BYTES = 38,
  COMMAND_BYTES = 12; // of the content, from the document

/** Least error that whole degrees allow. */
export const LEAST_ERROR = 1; // degree

/** Share of the way by share of the time: steady, slow at both ends, or quick at first and then slower. */
const SHARE = {
  linear: (/** @type {number} */ time) => time,
  soft: (/** @type {number} */ time) => (1 - Math.cos(Math.PI * time)) / 2,
  snap: (/** @type {number} */ time) => 1 - (1 - time) ** 3,
};

/**
 * Return the actions for a movement along a curve. All servos take the time of the slowest one.
 * @param {Curve} curve
 * @param {Pose} from pose before, in which servos may be missing
 * @param {readonly Step[]} steps of the movement
 * @param {number} error degrees from the curve, at most
 * @returns {Eased}
 */
export function eased(curve, from, steps, error) {
  const ways = steps.map(({ servo_id, degree }) => ({ servo_id, start: from[servo_id] ?? degree, end: degree }));
  const total = Math.max(UNIT, Math.round(Math.max(0, ...steps.map((step) => step.interval_ms)) / UNIT) * UNIT);
  const longest = Math.max(0, ...ways.map(({ start, end }) => Math.abs(end - start)));
  const share = (/** @type {number} */ time) => SHARE[curve](time / total);
  const knots = knotsOf(share, total, (error - ROUNDING) / Math.max(longest, ROUNDING));
  const at = (/** @type {(typeof ways)[number]} */ way, /** @type {number} */ time) =>
    way.start + (way.end - way.start) * share(time);
  const parts = knots.slice(1).map((knot, index) =>
    ways
      .map((way) => ({ way, degree: Math.round(at(way, knot)), before: Math.round(at(way, knots[index])) }))
      .filter(({ degree, before }) => degree !== before || knot === total)
      .map(({ way, degree }) => ({ servo_id: way.servo_id, degree, interval_ms: knot - knots[index] })),
  );
  let worst = 0;
  for (const way of ways)
    for (let index = 1; index < knots.length; index++) {
      const [low, high] = [Math.round(at(way, knots[index - 1])), Math.round(at(way, knots[index]))];
      const length = knots[index] - knots[index - 1];
      for (let time = 0; time <= length; time += UNIT)
        worst = Math.max(worst, Math.abs(low + ((high - low) * time) / length - at(way, knots[index - 1] + time)));
    }
  return { parts, worst };
}

/**
 * Return the times at which straight lines meet that stay near a curve: each line is as long as the error allows.
 * @param {(time: number) => number} share
 * @param {number} total milliseconds
 * @param {number} error share of the way
 */
function knotsOf(share, total, error) {
  const knots = [0];
  while (knots[knots.length - 1] < total) {
    const begin = knots[knots.length - 1];
    let end = begin + UNIT;
    while (end < total && isNear(share, begin, end + UNIT, error)) end += UNIT;
    knots.push(Math.min(end, total));
  }
  return knots;
}

/**
 * @param {(time: number) => number} share
 * @param {number} begin
 * @param {number} end
 * @param {number} error
 */
function isNear(share, begin, end, error) {
  const slope = (share(end) - share(begin)) / (end - begin);
  for (let time = begin; time < end; time += UNIT)
    if (Math.abs(share(begin) + slope * (time - begin) - share(time)) > error) return false;
  return true;
}

/**
 * Return the bytes that the actions of a movement take, with the macro that plays more than one.
 * @param {Step[][]} parts
 */
export const bytesOf = (parts) =>
  parts.reduce((sum, steps) => sum + ACTION_BYTES + STEP_BYTES * steps.length, 0) +
  (parts.length > 1 ? MACRO_BYTES + COMMAND_BYTES * parts.length : 0);
