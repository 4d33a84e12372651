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
const MOST_SLOW = 4; // such frames in a row, behind which WebGL is given up
const MOST_SLOW_MOVING = 2; // while this page moves the robot
const TRIALS = 8; // frames drawn at first without a change, for an early measurement of slow browsers

/** Draw all figures in each frame from now on. */
export function drawFigures() {
  let drewAt = 0,
    slow = 0,
    trials = 0;
  /** @param {number} now */
  const frame = (now) => {
    requestAnimationFrame(frame);
    if (document.hidden) return;
    // Without a graphics card the browser calculates each pixel itself. Flat figures keep the page alive, and with it
    // the beats without which the robot is stopped.
    if (drewAt > 0) slow = now - drewAt > SLOW ? slow + 1 : 0;
    if (slow >= (isMine.value ? MOST_SLOW_MOVING : MOST_SLOW)) drawFlatOnly();
    const drew = [...stages].map((stage) => stage.draw({ always: trials < TRIALS }));
    trials += Number(drew.includes(true));
    drewAt = drew.includes(true) ? now : 0;
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
