// Matrices (4 x 4, column major) and vectors of three numbers. Millimetres; x to the robot's left, y up, z forward.

/** @typedef {[number, number, number]} Vector */
/** @typedef {number[]} Matrix Sixteen numbers, column by column. */

/** Radians in one degree, for angles of joints. */
export const RADIANS = Math.PI / 180;

/** @type {Record<string, Vector>} */
export const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

/** @returns {Matrix} */
export const identity = () => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

/**
 * Return the matrix that applies `b` first, then `a`.
 * @param {Matrix} a
 * @param {Matrix} b
 * @returns {Matrix}
 */
export function multiply(a, b) {
  const product = new Array(16);
  for (let column = 0; column < 16; column += 4) {
    for (let row = 0; row < 4; row++) {
      product[column + row] =
        a[row] * b[column] + a[4 + row] * b[column + 1] + a[8 + row] * b[column + 2] + a[12 + row] * b[column + 3];
    }
  }
  return product;
}

/**
 * @param {Vector} by
 * @returns {Matrix}
 */
export function translation(by) {
  const matrix = identity();
  [matrix[12], matrix[13], matrix[14]] = by;
  return matrix;
}

/**
 * @param {Vector} axis of length 1
 * @param {number} degrees
 * @returns {Matrix}
 */
export function rotation(axis, degrees) {
  const [x, y, z] = axis;
  const angle = degrees * RADIANS;
  const c = Math.cos(angle),
    s = Math.sin(angle),
    t = 1 - c;
  return [
    t * x * x + c,
    t * x * y + s * z,
    t * x * z - s * y,
    0,
    t * x * y - s * z,
    t * y * y + c,
    t * y * z + s * x,
    0,
    t * x * z + s * y,
    t * y * z - s * x,
    t * z * z + c,
    0,
    0,
    0,
    0,
    1,
  ];
}

/**
 * Return the matrix of a turn, given as a unit quaternion w, x, y, z, and a move after it.
 * @param {[number, number, number, number]} turn
 * @param {Vector} at
 * @returns {Matrix}
 */
export function placement([w, x, y, z], at) {
  const half = Math.hypot(x, y, z),
    degrees = (2 * Math.atan2(half, w)) / RADIANS;
  const matrix = half > 0 ? rotation([x / half, y / half, z / half], degrees) : identity();
  [matrix[12], matrix[13], matrix[14]] = at;
  return matrix;
}

/**
 * Return the inverse of a matrix that only turns and moves.
 * @param {Matrix} m
 * @returns {Matrix}
 */
export function rigidInverse(m) {
  const inverse = [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0, 0, 0, 0, 1];
  const [x, y, z] = turnVector(inverse, [m[12], m[13], m[14]]);
  inverse[12] = -x;
  inverse[13] = -y;
  inverse[14] = -z;
  return inverse;
}

/**
 * Return a point, moved and turned.
 * @param {Matrix} m
 * @param {Vector} p
 * @returns {Vector}
 */
export function apply(m, p) {
  const [x, y, z] = turnVector(m, p);
  return [x + m[12], y + m[13], z + m[14]];
}

/**
 * Return a direction, turned but not moved.
 * @param {Matrix} m
 * @param {Vector} p
 * @returns {Vector}
 */
export function turnVector(m, p) {
  return [
    m[0] * p[0] + m[4] * p[1] + m[8] * p[2],
    m[1] * p[0] + m[5] * p[1] + m[9] * p[2],
    m[2] * p[0] + m[6] * p[1] + m[10] * p[2],
  ];
}

/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

/**
 * @param {Vector} a
 * @param {Vector} b
 */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/**
 * @param {Vector} a
 * @param {number} by
 * @returns {Vector}
 */
export const scale = (a, by) => [a[0] * by, a[1] * by, a[2] * by];

/**
 * Return a vector of length 1, or `a` itself if it has no length.
 * @param {Vector} a
 * @returns {Vector}
 */
export const normalize = (a) => scale(a, 1 / (Math.hypot(...a) || 1));
