// Fills a history and thins it out: what the tests cannot pass from Python are its rings.

import { History } from "../../servolink/studio/web/state/history.js";
import { Stretch } from "../../servolink/studio/web/state/stretch.js";

export function stretched(angles, hz, seconds, points) {
  const history = new History();
  angles.forEach((angle, at) => history.add(at / hz, [{ servo_id: 1, angle, current_raw: 0, temperature_raw: 0 }]));
  const stretch = new Stretch(history, seconds, points), { angle = new Float32Array() } = history.of(1);
  return [stretch.times(history.times), stretch.values(angle)].map((each) => [...each]);
}
