// Triangles of the shapes of a joint: rounded boxes and discs.

import { normalize, subtract } from "./matrix.js";

/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./figure.js").Box} Box */
/** @typedef {import("./figure.js").Disc} Disc */
/** @typedef {{ positions: number[], normals: number[], tones: number[], indexes: number[] }} Mesh */

/** @type {Record<import("./figure.js").Tone, number>} */
export const TONES = { shell: 0, limb: 1, dark: 2, glow: 3 };

const CORNER_STEPS = 7;
const DISC_STEPS = 28;
const DEFAULT_ROUND = 6; // millimetres

/**
 * Return the triangles of shapes.
 * @param {(Box | Disc)[]} shapes
 * @returns {Mesh}
 */
export function meshOf(shapes) {
  /** @type {Mesh} */
  const mesh = { positions: [], normals: [], tones: [], indexes: [] };
  for (const shape of shapes) {
    if ("box" in shape) addBox(shape, mesh);
    else addDisc(shape, mesh);
  }
  return mesh;
}

/**
 * @param {Box} shape
 * @param {Mesh} mesh
 */
function addBox(shape, mesh) {
  const half = /** @type {Vector} */ (shape.box.map((size) => size / 2));
  const round = Math.min(shape.round ?? DEFAULT_ROUND, ...half);
  for (let face = 0; face < 6; face++) addFace(shape, half, round, face, mesh);
}

/**
 * @param {Box} shape
 * @param {Vector} half
 * @param {number} round
 * @param {number} face 0..5
 * @param {Mesh} mesh
 */
function addFace(shape, half, round, face, mesh) {
  const at = shape.at ?? [0, 0, 0],
    tone = TONES[shape.tone ?? "shell"];
  const w = face >> 1,
    u = (w + 1) % 3,
    v = (w + 2) % 3,
    side = face & 1 ? 1 : -1;
  const across = ticks(half[u], round),
    up = ticks(half[v], round);
  const first = mesh.tones.length;
  for (const b of up) {
    for (const a of across) {
      /** @type {Vector} */
      const point = [0, 0, 0];
      point[w] = side * half[w];
      point[u] = a;
      point[v] = b;
      const inner = /** @type {Vector} */ (
        point.map((c, k) => Math.max(round - half[k], Math.min(half[k] - round, c)))
      );
      /** @type {Vector} */
      const outward = [0, 0, 0];
      outward[w] = side;
      const normal = round > 0 ? normalize(subtract(point, inner)) : outward;
      mesh.positions.push(
        inner[0] + normal[0] * round + at[0],
        inner[1] + normal[1] * round + at[1],
        inner[2] + normal[2] * round + at[2],
      );
      mesh.normals.push(...normal);
      mesh.tones.push(tone);
    }
  }
  addGrid(first, across.length, up.length, side > 0, mesh);
}

/**
 * Return the points of a face, most at the round corners.
 * @param {number} half
 * @param {number} round
 */
function ticks(half, round) {
  const low = [];
  for (let step = 0; step <= CORNER_STEPS; step++) {
    low.push(-half + round * (1 - Math.cos(((step / CORNER_STEPS) * Math.PI) / 2)));
  }
  return [...low, ...low.map((tick) => -tick).reverse()];
}

/**
 * @param {Disc} shape
 * @param {Mesh} mesh
 */
function addDisc(shape, mesh) {
  const [radius, length] = shape.disc,
    at = shape.at ?? [0, 0, 0],
    tone = TONES[shape.tone ?? "shell"];
  const w = { x: 0, y: 1, z: 2 }[shape.axis ?? "x"],
    u = (w + 1) % 3,
    v = (w + 2) % 3;
  const rings = profile(radius, length);
  const first = mesh.tones.length;
  for (const [out, along, normalOut, normalAlong] of rings) {
    for (let step = 0; step <= DISC_STEPS; step++) {
      const angle = (step / DISC_STEPS) * 2 * Math.PI;
      const point = [0, 0, 0],
        normal = [0, 0, 0];
      point[w] = along;
      point[u] = out * Math.cos(angle);
      point[v] = out * Math.sin(angle);
      normal[w] = normalAlong;
      normal[u] = normalOut * Math.cos(angle);
      normal[v] = normalOut * Math.sin(angle);
      mesh.positions.push(point[0] + at[0], point[1] + at[1], point[2] + at[2]);
      mesh.normals.push(...normal);
      mesh.tones.push(tone);
    }
  }
  addGrid(first, DISC_STEPS + 1, rings.length, true, mesh);
}

/**
 * Return the rings of a disc with bevelled edges: radius, place along the axis, and both parts of the normal.
 * @param {number} radius
 * @param {number} length
 * @returns {[number, number, number, number][]}
 */
function profile(radius, length) {
  const half = length / 2,
    bevel = Math.min(radius, length) * 0.18;
  /** @type {[number, number, number, number][]} */
  const front = [
    [radius, half - bevel, 1, 0],
    [radius, half - bevel, 0.86, 0.5],
    [radius - bevel, half, 0.5, 0.86],
    [radius - bevel, half, 0, 1],
    [0, half, 0, 1],
  ];
  /** @type {[number, number, number, number][]} */
  const back = front.map(([out, along, normalOut, normalAlong]) => [out, -along, normalOut, -normalAlong]);
  return [...back.reverse(), ...front];
}

/**
 * Add the triangles of a grid of points.
 * @param {number} first index of its first point
 * @param {number} width points in a row
 * @param {number} height rows
 * @param {boolean} isForward
 * @param {Mesh} mesh
 */
function addGrid(first, width, height, isForward, mesh) {
  for (let y = 0; y < height - 1; y++) {
    for (let x = 0; x < width - 1; x++) {
      const a = first + y * width + x,
        b = a + 1,
        c = a + width,
        d = c + 1;
      if (isForward) mesh.indexes.push(a, b, d, a, d, c);
      else mesh.indexes.push(a, d, b, a, c, d);
    }
  }
}
