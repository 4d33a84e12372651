// Draws figures without WebGL: each shape is a round stroke, the farthest first.

import { apply } from "./matrix.js";
import { palette } from "./palette.js";

/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./figure.js").Figure} Figure */
/** @typedef {import("./figure.js").Joint} Joint */
/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {import("./camera.js").Pixel} Pixel */
/** @typedef {import("./webgl.js").Layer} Layer */
/** @typedef {{ from: Pixel, to: Pixel, width: number, colour: Vector }} Stroke */

const EDGE = 2; // pixels

/**
 * Draw the layers of a figure, the first one on top.
 * @param {CanvasRenderingContext2D} context
 * @param {Figure} figure
 * @param {Camera} camera
 * @param {Layer[]} layers
 */
export function drawFlat(context, figure, camera, layers) {
  context.lineCap = "round";
  for (const layer of [...layers].reverse()) {
    const alpha = layer.alpha ?? 1,
      edge = css(palette().dark, alpha);
    for (const stroke of strokes(figure, camera, layer)) {
      line(context, stroke, stroke.width + EDGE, edge);
      line(context, stroke, stroke.width, css(layer.flat ?? stroke.colour, alpha));
    }
  }
}

/**
 * Return the strokes of a layer, the farthest first.
 * @param {Figure} figure
 * @param {Camera} camera
 * @param {Layer} layer
 * @returns {Stroke[]}
 */
function strokes(figure, camera, layer) {
  /** @type {Stroke[]} */
  const found = [];
  figure.joints.forEach((joint, index) => {
    const tint = layer.tintOf?.(joint);
    for (const shape of joint.shapes) {
      const size = "box" in shape ? shape.box : /** @type {Vector} */ (Array(3).fill(shape.disc[0] * 1.4));
      const at = shape.at ?? [0, 0, 0],
        longest = size.indexOf(Math.max(...size));
      const width = (size[0] + size[1] + size[2] - size[longest]) / 2;
      const half = Math.max(0, (size[longest] - width) / 2);
      const ends = [-half, half].map((away) => {
        const end = /** @type {Vector} */ (at.map((c, k) => (k === longest ? c + away : c)));
        return camera.project(apply(layer.matrices[index], end));
      });
      const colour = mixed(colourOf(joint, shape.tone ?? "shell"), tint ?? null);
      found.push({ from: ends[0], to: ends[1], width: width * camera.pixelsAt(ends[0].depth), colour });
    }
  });
  return found.sort((one, other) => other.from.depth + other.to.depth - one.from.depth - one.to.depth);
}

/**
 * @param {Joint} joint
 * @param {import("./figure.js").Tone} tone
 */
function colourOf(joint, tone) {
  const colours = palette();
  return tone === "limb" ? (colours.groups[joint.group] ?? colours.shell) : colours[tone];
}

/**
 * @param {Vector} colour
 * @param {import("./webgl.js").Tint | null} tint
 */
function mixed(colour, tint) {
  if (tint === null) return colour;
  return /** @type {Vector} */ (colour.map((c, k) => c + (tint.tint[k] - c) * tint.amount));
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Stroke} stroke
 * @param {number} width
 * @param {string} colour
 */
function line(context, stroke, width, colour) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  context.moveTo(stroke.from.x, stroke.from.y);
  context.lineTo(stroke.to.x + 0.01, stroke.to.y); // a stroke of no length would not be drawn
  context.stroke();
}

/**
 * @param {Vector} colour
 * @param {number} alpha
 */
const css = (colour, alpha) => `rgb(${colour.map((c) => Math.round(c * 255)).join(" ")} / ${alpha})`;
