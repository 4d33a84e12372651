// A camera that looks at a figure: from points to pixels and back.

import { RADIANS, cross, dot, multiply, normalize, subtract } from "./matrix.js";

/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./matrix.js").Matrix} Matrix */
/** @typedef {import("./figure.js").View} View */

const FIELD = 24 * RADIANS; // of view, from bottom to top
const NEAR = 50,
  FAR = 6000; // millimetres

/** @typedef {{ x: number, y: number, depth: number }} Pixel */

/** Where a view of the figure is seen from, on a canvas of a certain size in pixels. */
export class Camera {
  /**
   * @param {View} view
   * @param {number} width
   * @param {number} height
   */
  constructor(view, width, height) {
    this.width = width;
    this.height = height;
    const yaw = view.yaw * RADIANS,
      pitch = view.pitch * RADIANS,
      { target, distance } = view;
    /** @type {Vector} */
    this.eye = [
      target[0] + distance * Math.sin(yaw) * Math.cos(pitch),
      target[1] + distance * Math.sin(pitch),
      target[2] + distance * Math.cos(yaw) * Math.cos(pitch),
    ];
    this._ahead = normalize(subtract(target, this.eye));
    this._right = normalize(cross(this._ahead, [0, 1, 0]));
    this._up = cross(this._right, this._ahead);
    const aspect = width / height;
    this._narrow = Math.min(1, aspect); // a narrow canvas keeps the width of the figure in view
    /** @type {Matrix} */
    this.matrix = multiply(this._projection(aspect), this._look());
  }

  /**
   * Return where a point is seen.
   * @param {Vector} p
   * @returns {Pixel}
   */
  project(p) {
    const m = this.matrix,
      depth = m[3] * p[0] + m[7] * p[1] + m[11] * p[2] + m[15];
    const x = (m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12]) / depth;
    const y = (m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13]) / depth;
    return { x: (x / 2 + 0.5) * this.width, y: (0.5 - y / 2) * this.height, depth };
  }

  /**
   * Return the direction in which a pixel is seen.
   * @param {number} x
   * @param {number} y
   * @returns {Vector}
   */
  direction(x, y) {
    const reach = Math.tan(FIELD / 2) / this._narrow;
    const right = ((x / this.width) * 2 - 1) * reach * (this.width / this.height);
    const up = (1 - (y / this.height) * 2) * reach;
    const [a, r, u] = [this._ahead, this._right, this._up];
    return normalize([
      a[0] + r[0] * right + u[0] * up,
      a[1] + r[1] * right + u[1] * up,
      a[2] + r[2] * right + u[2] * up,
    ]);
  }

  /**
   * Return the point seen at a pixel that is as far ahead as another point.
   * @param {number} x
   * @param {number} y
   * @param {Vector} point
   * @returns {Vector}
   */
  pointBeside(x, y, point) {
    const direction = this.direction(x, y),
      distance = dot(subtract(point, this.eye), this._ahead) / dot(direction, this._ahead);
    return [
      this.eye[0] + direction[0] * distance,
      this.eye[1] + direction[1] * distance,
      this.eye[2] + direction[2] * distance,
    ];
  }

  /**
   * Return how many pixels a millimetre takes at a depth.
   * @param {number} depth
   */
  pixelsAt(depth) {
    return this.height / (depth * Math.tan(FIELD / 2) * 2);
  }

  /** @returns {Matrix} */
  _look() {
    const [f, s, u, eye] = [this._ahead, this._right, this._up, this.eye];
    return [
      s[0],
      u[0],
      -f[0],
      0,
      s[1],
      u[1],
      -f[1],
      0,
      s[2],
      u[2],
      -f[2],
      0,
      -dot(s, eye),
      -dot(u, eye),
      dot(f, eye),
      1,
    ];
  }

  /**
   * @param {number} aspect
   * @returns {Matrix}
   */
  _projection(aspect) {
    const size = this._narrow / Math.tan(FIELD / 2);
    return [
      size / aspect,
      0,
      0,
      0,
      0,
      size,
      0,
      0,
      0,
      0,
      (FAR + NEAR) / (NEAR - FAR),
      -1,
      0,
      0,
      (2 * FAR * NEAR) / (NEAR - FAR),
      0,
    ];
  }
}
