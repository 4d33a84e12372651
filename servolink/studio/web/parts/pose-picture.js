// Small picture of a pose, drawn at first sight and after changes.

import { html, useEffect, useRef } from "../html.js";
import { Stage } from "../figure/stage.js";
import { figure } from "../state/figure.js";
import { theme } from "../state/settings.js";

/** @typedef {import("../figure/figure.js").Pose} Pose */

const NEARER = 1.02; // distance of the camera, compared with that of a stage

/** @param {{ pose: Pose, distance?: number }} props */
export function PosePicture({ pose, distance = NEARER }) {
  const canvas = useRef(/** @type {HTMLCanvasElement | null} */ (null));
  const robot = figure.value,
    look = `${theme.value} ${JSON.stringify(pose)}`;
  useEffect(() => {
    const element = canvas.current;
    if (element === null || robot === null) return undefined;
    const view = { distance: robot.data.view.distance * distance };
    const stage = new Stage(element, robot, { pose: () => pose, hasGrid: false }, view);
    const seen = new IntersectionObserver((entries) => entries.some((entry) => entry.isIntersecting) && stage.draw());
    seen.observe(element);
    return () => seen.disconnect();
  }, [robot, look]);
  return html`<canvas ref=${canvas} aria-hidden="true" />`;
}
