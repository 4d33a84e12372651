// Where points of the figures that come with the studio are in poses.

import { readFileSync } from "node:fs";

import { Figure } from "../../servolink/studio/web/figure/figure.js";
import { apply } from "../../servolink/studio/web/figure/matrix.js";

const figures = new URL("../../servolink/studio/web/figures/", import.meta.url);

export function placeOf(template, pose, joint, point) {
  const figure = new Figure(JSON.parse(readFileSync(new URL(`${template}.figure.json`, figures), "utf8")));
  return apply(figure.solve(pose)[figure.indexOf(joint)], point);
}

export function placesOf(template, body) {
  const figure = new Figure(JSON.parse(readFileSync(new URL(`${template}.figure.json`, figures), "utf8")));
  return figure.place(body).map((matrix) => apply(matrix, [0, 0, 0]));
}

export function framesOf(data, poses) {
  const figure = new Figure(data);
  return poses.map((pose) => figure.place({ pose, move: [0, 0, 0], turn: [1, 0, 0, 0] }).map((matrix) => [...matrix]));
}
