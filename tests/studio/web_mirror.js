// Makes a mirror and uses it: what the tests cannot pass from Python are a figure and functions.

import { Figure } from "../../servolink/studio/web/figure/figure.js";
import { mirrored, mirrorOf } from "../../servolink/studio/web/state/mirror.js";

export function mirroredSteps(figure, parameters, steps) {
  return mirrored(steps, mirrorOf(figure === null ? null : new Figure(figure), parameters));
}
