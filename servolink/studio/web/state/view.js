// What this page shows: the screen, the chosen servo, and what is drafted for the servos.

import { signal } from "../html.js";

/** @typedef {import("../figure/figure.js").Pose} Pose */

/** The screen, as in the part of the address behind `#`. */
export const screen = signal("live");
/** The chosen servo: the same one on every screen. */
export const chosen = signal(/** @type {number | null} */ (null));
/** Whether dragging moves the robot, or a draft. */
export const mode = signal(/** @type {"preview" | "robot"} */ ("preview"));
/** The targets that were set in Preview and not sent. */
export const draft = signal(/** @type {Pose} */ ({}));
/** Whether the list of keys is shown. */
export const showsKeys = signal(false);
/** The chosen action and macro, by id. */
export const chosenAction = signal(0);
export const chosenMacro = signal(0);
