// A canvas with the figure, drawn again in each frame of the browser while it can be seen.

import { html, useEffect, useRef } from "../html.js";
import { Stage, drawFlatOnly } from "../figure/stage.js";
import { isMine } from "../state/robot.js";

/** @typedef {import("../figure/figure.js").Figure} Figure */
/** @typedef {import("../figure/stage.js").Scene} Scene */
/** @typedef {import("../state/view.js").ViewName} ViewName */

/** @type {Set<Stage>} */
const stages = new Set();

const TURN = 8; // degrees with each arrow key

/** @type {Record<ViewName, { yaw: number, pitch: number }>} */
const VIEWS = { front: { yaw: 0, pitch: 6 }, side: { yaw: 90, pitch: 6 }, free: { yaw: 24, pitch: 9 } };

const SLOW = 120; // milliseconds from one frame to the next
const FAR_TOO_SLOW = 250; // milliseconds: two such frames may cost the beats that keep the robot moving
const MOST_SLOW = 4; // slow frames in a row, behind which a lighter way of drawing is taken
const MOST_SLOW_MOVING = 2; // while this page moves the robot
const RARELY = 300; // milliseconds between two drawings in the lightest way
const TRIALS = 8; // frames drawn at first without a change, for an early measurement of slow browsers

/** Way of drawing: with WebGL, flat, or flat and rarely. @type {0 | 1 | 2} */
let way = 0;

/** Draw in a lighter way from now on. Return false if there is none. */
export function drawLighter() {
  if (way === 2) return false;
  way = way === 0 ? 1 : 2;
  drawFlatOnly();
  return true;
}

/** Draw all figures in each frame from now on. */
export function drawFigures() {
  let drewAt = 0,
    latest = 0,
    slow = 0,
    trials = 0;
  /** @param {number} now */
  const frame = (now) => {
    requestAnimationFrame(frame);
    if (document.hidden || (way === 2 && now - latest < RARELY)) {
      drewAt = 0;
      return;
    }
    // Without a graphics card the browser calculates each pixel itself. Flat figures keep the page alive, and with it
    // the beats without which the robot is stopped.
    const took = drewAt > 0 ? now - drewAt : 0;
    slow = took > SLOW ? slow + 1 : 0;
    if (took > FAR_TOO_SLOW || slow >= (isMine.value ? MOST_SLOW_MOVING : MOST_SLOW)) {
      drawLighter();
      slow = 0;
    }
    const drew = [...stages].map((stage) => stage.draw({ always: trials < TRIALS }));
    trials += Number(drew.includes(true));
    drewAt = drew.includes(true) ? now : 0;
    if (drewAt > 0) latest = now;
  };
  requestAnimationFrame(frame);
}

/**
 * @typedef {object} Props
 * @property {Figure} figure
 * @property {Scene} scene
 * @property {string} label
 * @property {ViewName} [view]
 * @property {(event: KeyboardEvent) => boolean} [onKey] return whether the key was used; otherwise arrows turn the view
 */

/** @param {Props} props */
export function FigureStage({ figure, scene, label, view = "free", onKey }) {
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  const stage = useRef(/** @type {Stage | null} */ (null));
  useEffect(() => {
    const made = new Stage(/** @type {HTMLCanvasElement} */ (canvas.current), figure, scene);
    stage.current = made;
    made.listen();
    stages.add(made);
    return () => {
      stages.delete(made);
      made.dispose();
    };
  }, [figure]);
  useEffect(() => {
    if (stage.current) stage.current.scene = scene;
  });
  useEffect(() => {
    if (stage.current) Object.assign(stage.current.view, VIEWS[view]);
  }, [view, figure]);
  /** @param {KeyboardEvent} event */
  const turn = (event) => {
    if (onKey?.(event)) return event.preventDefault();
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (way === undefined || stage.current === null || event.shiftKey) return;
    stage.current.view.yaw += way * TURN;
    event.preventDefault();
  };
  return html`<canvas ref=${canvas} tabindex="0" role="img" aria-label=${label} onKeyDown=${turn} />`;
}
