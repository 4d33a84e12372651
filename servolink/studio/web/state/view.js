// View of the page: screen, chosen servo, action and macro, and unsent targets.

import { signal } from "../html.js";

/** @typedef {import("../figure/figure.js").Pose} Pose */
/** Direction from which a figure is seen. @typedef {"front" | "side" | "free"} ViewName */
/** @typedef {"preview" | "robot"} Mode */
/** @typedef {import("./history.js").Quantity} Quantity */

/** The screen, as in the part of the address behind `#`. */
export const screen = signal("live");
/** The chosen servo: the same one on every screen. */
export const chosen = signal(/** @type {number | null} */ (null));
/** Whether dragging moves the robot, or a draft. */
export const mode = signal(/** @type {Mode} */ ("preview"));
/** The targets that were set in Preview and not sent. */
export const draft = signal(/** @type {Pose} */ ({}));
/** Whether the list of keys is shown. */
export const showsKeys = signal(false);
/** The chosen action and macro, by id. */
export const chosenAction = signal(0);
/** Id of the macro chosen on the screen; 0 for none. */
export const chosenMacro = signal(0);
/** The limb that the screen Live shows on a phone. */
export const shownLimb = signal("");
/** The readings that the screen Live plots. */
export const plottedQuantity = signal(/** @type {Quantity} */ ("angle"));

const view = () => signal(/** @type {ViewName} */ ("free"));
/** Direction from which the figure of each screen is seen. */
export const views = { live: view(), actions: view(), macros: view(), teach: view() };

/** @param {string} name */
export function showScreen(name) {
  screen.value = name;
}

/** @param {number | null} id */
export function chooseServo(id) {
  chosen.value = id;
}

/** @param {Mode} name */
export function chooseMode(name) {
  mode.value = name;
}

/**
 * Set the target of a servo, to be sent later.
 * @param {number} id
 * @param {number} angle
 */
export function draftTarget(id, angle) {
  draft.value = { ...draft.value, [id]: angle };
}

/** Forget the targets that were not sent. */
export function dropTargets() {
  draft.value = {};
}

/** @param {boolean} isShown */
export function showKeys(isShown) {
  showsKeys.value = isShown;
}

/** @param {number} id */
export function chooseAction(id) {
  chosenAction.value = id;
}

/** @param {number} id */
export function chooseMacro(id) {
  chosenMacro.value = id;
}

/** @param {string} limb */
export function showLimb(limb) {
  shownLimb.value = limb;
}

/** @param {Quantity} quantity */
export function plotQuantity(quantity) {
  plottedQuantity.value = quantity;
}

/**
 * Look at the figure of a screen from another direction.
 * @param {keyof typeof views} name
 * @param {ViewName} from
 */
export function lookFrom(name, from) {
  views[name].value = from;
}
