// Nudges of a servo: a step for each press, and more steps while a control is held. The step of a short press is carried
// out to the end, also after a release before the hub has given the lease.

import { t } from "../texts/text.js";
import { refusal } from "./motion.js";
import { servos } from "./robot.js";

/** @typedef {import("./motion.js").Motion} Motion */

const TURNS = 0.2; // seconds of the movement of a step
const EVERY = 0.4; // seconds from one step to the next
const LATEST = 2000; // milliseconds after a press; a later step would surprise people

/** Nudges one servo. */
export class Nudges {
  #motion;
  #id;
  /** Degrees of the control that is held; 0 for none. */
  #held = 0;
  /** Steps pressed and not begun; null without a nudge under way. @type {number[] | null} */
  #steps = null;

  /**
   * @param {Motion} motion
   * @param {number} id
   */
  constructor(motion, id) {
    this.#motion = motion;
    this.#id = id;
  }

  /**
   * Turn the servo by some degrees, and on until `release` is called.
   * @param {number} way
   */
  async press(way) {
    this.#held = way;
    if (this.#steps !== null && this.#motion.isHeld) return void this.#steps.push(way);
    const steps = (this.#steps = [way]),
      pressedAt = performance.now();
    const mayMove = await this.#motion.begin();
    if (this.#steps !== steps) return; // stopped, and pressed again
    const isLate = this.#held === 0 && performance.now() - pressedAt > LATEST;
    if (mayMove && isLate) refusal.value = t("servos.too_late");
    if (mayMove && (isLate || (await this.#turn(steps)))) this.#motion.end();
    if (this.#steps === steps) this.#steps = null;
  }

  /** End after the pressed steps. */
  release() {
    this.#held = 0;
  }

  /**
   * Carry out steps. Return whether all were carried out, and nothing else moves the servos.
   * @param {number[]} steps
   */
  async #turn(steps) {
    let target = Math.round(servos.value.get(this.#id)?.angle ?? 0);
    for (let way = steps.shift() ?? 0; way !== 0; way = steps.shift() ?? this.#held) {
      target += way;
      const step = { at: 0, duration: TURNS, targets: { [this.#id]: target } };
      if (!(await this.#motion.play([step], EVERY))) return false;
    }
    return true;
  }
}
