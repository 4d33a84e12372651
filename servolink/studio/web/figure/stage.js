// Canvas of a figure: draws the figure, turns the view, and reports clicked or dragged limbs.

import { Camera } from "./camera.js";
import { drawFlat } from "./flat.js";
import { drawGizmo } from "./gizmo.js";
import { apply, rigidInverse, subtract, turnVector } from "./matrix.js";
import { palette } from "./palette.js";
import { draggedAngle, jointAt } from "./picking.js";
import { Renderer } from "./webgl.js";

/** @typedef {import("./figure.js").Figure} Figure */
/** @typedef {import("./figure.js").Body} Body */
/** @typedef {import("./figure.js").Joint} Joint */
/** @typedef {import("./figure.js").Pose} Pose */
/** @typedef {import("./figure.js").View} View */
/** @typedef {import("./webgl.js").Tint} Tint */
/**
 * Scene of a stage: functions called at each drawing, and handlers for actions of a person.
 * @typedef {object} Scene
 * @property {() => Pose} pose
 * @property {() => Body | null} [body] the figure with physics, in place of the pose; null without
 * @property {() => Pose} [dragPose] the pose that a drag changes, if it is not the one shown
 * @property {() => Pose | null} [ghost] another pose, pale
 * @property {() => Pose | null} [target] where it is going, pale
 * @property {(joint: Joint) => Tint | null} [tintOf]
 * @property {() => number | null} [chosen] servo id
 * @property {boolean} [hasGrid]
 * @property {boolean} [hasGizmo]
 * @property {(servoId: number) => void} [onPick]
 * @property {(servoId: number, angle: number) => void} [onDrag] degrees, within the limits of the figure
 * @property {() => boolean} [canReach] whether the end of a limb is pulled to a place
 * @property {(joint: string, move: import("./matrix.js").Vector, start: Pose) => void} [onReach] the end of a limb is
 *   pulled from where it is in the pose `start`, in the frame of the base
 * @property {(servoId: number) => void} [onGrab]
 * @property {(servoId: number) => void} [onRelease] also when the pointer is lost
 */

/** End of a limb that is pulled, from a point in a pose. @typedef {{ joint: Joint, from: import("./matrix.js").Vector, start: Pose }} Pull */

const MOST_SCALE = 2; // device pixels for each pixel
const GHOST_ALPHA = { day: 0.2, night: 0.26 };
const NEAREST = 500,
  FARTHEST = 3200; // millimetres
const LOWEST = -5,
  HIGHEST = 75; // degrees

/** @type {Renderer | null | undefined} undefined until the first drawing, null without WebGL2 */
let renderer;

/** Return the renderer of the page; null where WebGL2 is missing, or was lost. */
function sharedRenderer() {
  if (renderer === undefined || renderer?.isLost) renderer = renderer === undefined ? Renderer.create() : null;
  return renderer;
}

/** Draw without WebGL2 from now on, as in browsers without support. */
export function drawFlatOnly() {
  renderer = null;
}

/** One view of a figure. */
export class Stage {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Figure} figure
   * @param {Scene} scene
   * @param {Partial<View>} [view]
   */
  constructor(canvas, figure, scene, view) {
    this.canvas = canvas;
    this.figure = figure;
    this.scene = scene;
    /** @type {View} */
    this.view = { ...figure.data.view, ...view };
    this._context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    /** @type {import("./matrix.js").Matrix[]} */
    this._matrices = [];
    this._camera = new Camera(this.view, 1, 1);
    /** @type {number | null} */
    this._hovered = null;
    /** @type {{ servoId: number | null, x: number, y: number, pull?: Pull } | null} */
    this._grip = null;
    this._ends = new AbortController();
    this._drawn = "";
  }

  /** Take part in clicks, drags and the wheel, until `dispose`. */
  listen() {
    const canvas = this.canvas,
      options = { signal: this._ends.signal };
    canvas.addEventListener("pointerdown", (event) => this._begin(event), options);
    canvas.addEventListener("pointermove", (event) => this._move(event), options);
    for (const name of /** @type {const} */ (["pointerup", "pointercancel", "lostpointercapture"])) {
      canvas.addEventListener(name, () => this.release(), options);
    }
    canvas.addEventListener("pointerleave", () => (this._hovered = null), options);
    canvas.addEventListener("wheel", (event) => this._zoom(event), { ...options, passive: false });
  }

  /** Stop listening; what is held is released. */
  dispose() {
    this.release();
    this._ends.abort();
  }

  /** Release the limb that is held, if any. */
  release() {
    const { servoId = null, pull } = this._grip ?? {};
    this._grip = null;
    if (servoId !== null || pull) this.scene.onRelease?.(servoId ?? 0);
  }

  /**
   * Draw everything as it is now, and return true; unless it looks the same as the last time.
   * @param {{ always?: boolean }} [options] `always`: even then
   */
  draw({ always = false } = {}) {
    const { width, height } = this.canvas.getBoundingClientRect();
    if (width === 0 || height === 0) return false;
    const scale = Math.min(MOST_SCALE, window.devicePixelRatio || 1);
    this._resize(Math.round(width * scale), Math.round(height * scale));
    const pose = this.scene.pose(),
      look = this._look(pose);
    if (look === this._drawn && !always) return false;
    this._draw(pose, new Camera(this.view, width, height), scale);
    this._drawn = look;
    return true;
  }

  /**
   * @param {Pose} pose
   * @param {Camera} camera
   * @param {number} scale
   */
  _draw(pose, camera, scale) {
    this._camera = camera;
    const layers = this._layers(pose),
      context = this._context;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    const gl = sharedRenderer();
    if (gl !== null) {
      const drawing = { scale, hasFloor: true, hasGrid: this.scene.hasGrid ?? true };
      const drawn = gl.draw(this.figure, camera, layers, drawing);
      context.drawImage(gl.canvas, 0, 0, drawn.width, drawn.height, 0, 0, drawn.width, drawn.height);
    }
    context.scale(scale, scale);
    if (gl === null) drawFlat(context, this.figure, camera, layers);
    const chosen = this.scene.chosen?.() ?? null;
    if (chosen !== null && this.scene.hasGizmo && !this.scene.body?.()) {
      drawGizmo(context, this.figure, camera, this._matrices, chosen, pose[chosen] ?? 0);
    }
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  _resize(width, height) {
    if (this.canvas.width === width && this.canvas.height === height) return; // setting them clears the canvas
    this.canvas.width = width;
    this.canvas.height = height;
    this._drawn = "";
  }

  /**
   * Return everything on which the drawing depends.
   * @param {Pose} pose
   */
  _look(pose) {
    const scene = this.scene,
      colours = palette();
    const tints = this.figure.joints.map((joint) => scene.tintOf?.(joint) ?? 0);
    return JSON.stringify([
      pose,
      scene.body?.(),
      scene.ghost?.(),
      scene.target?.(),
      scene.chosen?.(),
      tints,
      this._hovered,
      this.view,
      colours.isNight,
      colours.accent,
    ]);
  }

  /** @param {Pose} pose */
  _layers(pose) {
    const { accent, isNight } = palette(),
      alpha = isNight ? GHOST_ALPHA.night : GHOST_ALPHA.day;
    const body = this.scene.body?.() ?? null;
    this._matrices = body === null ? this.figure.solve(pose) : this.figure.place(body);
    /** @type {import("./webgl.js").Layer[]} */
    const layers = [{ matrices: this._matrices, tintOf: (joint) => this._tintOf(joint) }];
    for (const pale of body === null ? [this.scene.ghost?.(), this.scene.target?.()] : []) {
      if (pale) layers.push({ matrices: this.figure.solve(pale), alpha, flat: accent });
    }
    return layers;
  }

  /**
   * @param {Joint} joint
   * @returns {Tint | null}
   */
  _tintOf(joint) {
    const own = this.scene.tintOf?.(joint),
      servoId = joint.servo ?? joint.follows;
    if (own) return own;
    if (servoId === undefined) return null;
    if (servoId === this.scene.chosen?.()) return { tint: palette().accent, amount: 0.5 };
    return servoId === this._hovered ? { tint: palette().accent, amount: 0.3 } : null;
  }

  /** @param {PointerEvent} event */
  _begin(event) {
    const { x, y } = this._place(event),
      joint = this._jointAt(x, y),
      servoId = servoOf(joint);
    this.canvas.setPointerCapture(event.pointerId);
    if (servoId !== null) this.scene.onPick?.(servoId);
    const held = servoId !== null && this.scene.onDrag ? servoId : null;
    this._grip = { servoId: held, x, y, pull: held !== null || servoId === null ? this._pull(joint, x, y) : undefined };
    if (held !== null) this.scene.onGrab?.(held);
  }

  /** @param {PointerEvent} event */
  _move(event) {
    const { x, y } = this._place(event),
      grip = this._grip;
    if (grip === null) {
      this._hovered = servoOf(this._jointAt(x, y));
      this.canvas.dataset.over = this._hovered === null ? "floor" : "limb";
      return;
    }
    const right = x - grip.x,
      down = y - grip.y;
    this._grip = { ...grip, x, y };
    if (grip.pull) this._reach(grip.pull, x, y);
    else if (grip.servoId === null) this._orbit(right, down);
    else {
      const pose = (this.scene.dragPose ?? this.scene.pose)();
      const angle = draggedAngle(this.figure, pose, this._camera, grip.servoId, right, down);
      this.scene.onDrag?.(grip.servoId, angle);
    }
  }

  /**
   * @param {number} right pixels
   * @param {number} down pixels
   */
  _orbit(right, down) {
    this.view.yaw -= right * 0.4;
    this.view.pitch = Math.max(LOWEST, Math.min(HIGHEST, this.view.pitch + down * 0.3));
  }

  /** @param {WheelEvent} event */
  _zoom(event) {
    event.preventDefault();
    const distance = this.view.distance * (1 + event.deltaY * 0.001);
    this.view.distance = Math.max(NEAREST, Math.min(FARTHEST, distance));
  }

  /** @param {PointerEvent} event */
  _place(event) {
    const { left, top } = this.canvas.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  _jointAt(x, y) {
    return this._matrices.length > 0 ? jointAt(this.figure, this._matrices, this._camera, x, y) : null;
  }

  /**
   * Return the pull of a joint that was grabbed, if its end is pulled.
   * @param {Joint | null} joint
   * @param {number} x
   * @param {number} y
   * @returns {Pull | undefined}
   */
  _pull(joint, x, y) {
    if (joint === null || !this.scene.canReach?.() || !this.figure.isEnd(joint)) return undefined;
    const start = (this.scene.dragPose ?? this.scene.pose)(),
      tip = apply(this.figure.solve(start)[this.figure.indexOf(joint.id)], joint.tip);
    return { joint, start, from: this._camera.pointBeside(x, y, tip) };
  }

  /**
   * @param {Pull} pull
   * @param {number} x
   * @param {number} y
   */
  _reach({ joint, from, start }, x, y) {
    const away = subtract(this._camera.pointBeside(x, y, from), from);
    this.scene.onReach?.(joint.id, turnVector(rigidInverse(this.figure.rootOf(start)), away), start);
  }
}

/** @param {Joint | null} joint */
const servoOf = (joint) => joint?.servo ?? joint?.follows ?? null;
