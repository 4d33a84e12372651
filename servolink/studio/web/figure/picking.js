// From a pixel to the limb that is seen there, and from a drag to degrees.

import { apply, rigidInverse, turnVector } from "./matrix.js";

/** @typedef {import("./matrix.js").Matrix} Matrix */
/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {import("./figure.js").Figure} Figure */
/** @typedef {import("./figure.js").Joint} Joint */
/** @typedef {import("./figure.js").Pose} Pose */

const MARGIN = 3; // millimetres around a shape that count as part of the shape
const MOST_DEGREES = 12; // in one step of a drag
const LEAST_WAY = 0.02; // square of the least pixels per degree of a limb for a drag
const DEGREES_PER_PIXEL = 0.6; // for a limb that points at the viewer

/**
 * Return the joint whose shape is nearest at a pixel, null if there is none.
 * @param {Figure} figure
 * @param {Matrix[]} matrices
 * @param {Camera} camera
 * @param {number} x
 * @param {number} y
 * @returns {Joint | null}
 */
export function jointAt(figure, matrices, camera, x, y) {
  const direction = camera.direction(x, y);
  let nearest = Infinity;
  /** @type {Joint | null} */
  let found = null;
  figure.joints.forEach((joint, index) => {
    const inverse = rigidInverse(matrices[index]);
    const from = apply(inverse, camera.eye),
      ray = turnVector(inverse, direction);
    for (const shape of joint.shapes) {
      const half = "box" in shape ? shape.box.map((size) => size / 2 + MARGIN) : Array(3).fill(shape.disc[0]);
      const distance = distanceToBox(from, ray, shape.at ?? [0, 0, 0], /** @type {Vector} */ (half));
      if (distance < nearest) {
        nearest = distance;
        found = joint;
      }
    }
  });
  return found;
}

/**
 * Return how far along a ray a box begins; infinite if the ray misses it.
 * @param {Vector} from
 * @param {Vector} ray
 * @param {Vector} middle
 * @param {Vector} half
 */
function distanceToBox(from, ray, middle, half) {
  let enter = -Infinity,
    leave = Infinity;
  for (let k = 0; k < 3; k++) {
    const one = (middle[k] - half[k] - from[k]) / ray[k],
      other = (middle[k] + half[k] - from[k]) / ray[k];
    enter = Math.max(enter, Math.min(one, other));
    leave = Math.min(leave, Math.max(one, other));
  }
  return enter < leave ? enter : Infinity;
}

/**
 * Return the angle of a servo whose limb was dragged by some pixels, within its limits.
 * @param {Figure} figure
 * @param {Pose} pose
 * @param {Camera} camera
 * @param {number} servoId
 * @param {number} right pixels
 * @param {number} down pixels
 */
export function draggedAngle(figure, pose, camera, servoId, right, down) {
  const joint = figure.byServo.get(servoId),
    before = pose[servoId] ?? 0;
  if (joint === undefined) return before;
  const index = figure.indexOf(joint.id);
  const here = camera.project(apply(figure.solve(pose)[index], joint.tip));
  const there = camera.project(apply(figure.solve({ ...pose, [servoId]: before + 1 })[index], joint.tip));
  const x = there.x - here.x,
    y = there.y - here.y,
    way = x * x + y * y;
  const degrees = way < LEAST_WAY ? -down * DEGREES_PER_PIXEL : (right * x + down * y) / way;
  const step = Math.max(-MOST_DEGREES, Math.min(MOST_DEGREES, degrees));
  return Math.max(joint.limits[0], Math.min(joint.limits[1], before + step));
}
