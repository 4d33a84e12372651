// An arc about the joint of the chosen servo: its limits, and where it stands.

import { apply, dot, multiply, normalize, rotation, scale, subtract, turnVector } from "./matrix.js";
import { palette } from "./palette.js";

/** @typedef {import("./matrix.js").Matrix} Matrix */
/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {import("./figure.js").Figure} Figure */
/** @typedef {import("./figure.js").Joint} Joint */

const LEAST_RADIUS = 44,
  MOST_RADIUS = 74; // millimetres
const STEP = 4; // degrees between two points of the arc
const KNOB = 8; // pixels
const LABEL = { height: 22, padding: 7, font: "600 13px Inter, system-ui, sans-serif", away: 1.34 };

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Figure} figure
 * @param {Camera} camera
 * @param {Matrix[]} matrices
 * @param {number} servoId
 * @param {number} angle degrees
 */
export function drawGizmo(context, figure, camera, matrices, servoId, angle) {
  const joint = figure.byServo.get(servoId);
  if (joint === undefined) return;
  const matrix = matrices[figure.indexOf(joint.id)],
    colours = palette().css;
  const pointAt = arc(joint, matrix, angle, camera);
  const [low, high] = joint.limits;
  context.lineCap = "round";
  drawArc(context, pointAt, low, high, colours.panel, 7, 0.9);
  drawArc(context, pointAt, low, high, colours.muted, 2.5, 0.55);
  if (Math.abs(angle) > 0.5) drawArc(context, pointAt, 0, angle, colours.accent, 4, 1);
  const middle = camera.project(apply(matrix, [0, 0, 0])),
    knob = pointAt(angle, 1);
  drawHand(context, middle, knob, colours.accent);
  drawKnob(context, knob, colours);
  drawLabel(context, camera, pointAt(angle, LABEL.away), angle, colours);
}

/**
 * Return a function from an angle, and a multiple of the radius, to the pixel there.
 * @param {Joint} joint
 * @param {Matrix} matrix
 * @param {number} angle
 * @param {Camera} camera
 */
function arc(joint, matrix, angle, camera) {
  const unturned = multiply(matrix, rotation(joint.axis, -(joint.sign * angle + joint.offset)));
  let towards = subtract(joint.tip, scale(joint.axis, dot(joint.tip, joint.axis)));
  if (Math.hypot(...towards) < 5) towards = Math.abs(joint.axis[2]) < 0.9 ? [0, 0, 40] : [40, 0, 0];
  const radius = Math.max(LEAST_RADIUS, Math.min(MOST_RADIUS, Math.hypot(...towards)));
  const hand = scale(normalize(towards), radius);
  /**
   * @param {number} degrees
   * @param {number} times
   */
  return (degrees, times) => {
    const turned = turnVector(rotation(joint.axis, joint.sign * degrees + joint.offset), hand);
    return camera.project(apply(unturned, scale(turned, times)));
  };
}

/** @typedef {ReturnType<typeof arc>} PointAt */
/** @typedef {ReturnType<PointAt>} Pixel */

/**
 * @param {CanvasRenderingContext2D} context
 * @param {PointAt} pointAt
 * @param {number} from degrees
 * @param {number} to degrees
 * @param {string} colour
 * @param {number} width
 * @param {number} alpha
 */
function drawArc(context, pointAt, from, to, colour, width, alpha) {
  const steps = Math.max(1, Math.ceil(Math.abs(to - from) / STEP));
  context.beginPath();
  for (let step = 0; step <= steps; step++) {
    const point = pointAt(from + ((to - from) * step) / steps, 1);
    if (step === 0) context.moveTo(point.x, point.y);
    else context.lineTo(point.x, point.y);
  }
  context.globalAlpha = alpha;
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
  context.globalAlpha = 1;
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Pixel} from
 * @param {Pixel} to
 * @param {string} colour
 */
function drawHand(context, from, to, colour) {
  context.beginPath();
  context.moveTo(from.x, from.y);
  context.lineTo(to.x, to.y);
  context.strokeStyle = colour;
  context.lineWidth = 1.5;
  context.setLineDash([3, 4]);
  context.stroke();
  context.setLineDash([]);
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Pixel} at
 * @param {Record<"panel" | "accent", string>} colours
 */
function drawKnob(context, at, colours) {
  context.beginPath();
  context.arc(at.x, at.y, KNOB, 0, 2 * Math.PI);
  context.fillStyle = colours.panel;
  context.fill();
  context.lineWidth = 3;
  context.strokeStyle = colours.accent;
  context.stroke();
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Camera} camera
 * @param {Pixel} at
 * @param {number} angle
 * @param {Record<"panel" | "ink", string>} colours
 */
function drawLabel(context, camera, at, angle, colours) {
  const text = `${Math.round(angle) || 0}°`.replace("-", "\u2212");
  context.font = LABEL.font;
  const width = context.measureText(text).width + 2 * LABEL.padding;
  const x = Math.max(4, Math.min(camera.width - width - 4, at.x - width / 2));
  const y = Math.max(4, Math.min(camera.height - LABEL.height - 4, at.y - LABEL.height / 2));
  context.fillStyle = colours.ink;
  context.beginPath();
  context.roundRect(x, y, width, LABEL.height, 6);
  context.fill();
  context.fillStyle = colours.panel;
  context.textBaseline = "middle";
  context.textAlign = "left";
  context.fillText(text, x + LABEL.padding, y + LABEL.height / 2 + 0.5);
}
