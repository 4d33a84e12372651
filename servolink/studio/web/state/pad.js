// Pad of the screen Buttons: chosen table and button, and presses on the pad or on a gamepad. In Robot mode presses start
// macros as the board's own buttons do.

import { signal } from "../html.js";

/** @typedef {import("./records.js").Button} Button */
/** @typedef {{ button: (id: number) => Button, seconds: (macroId: number) => number, run: (macroId: number, seconds: number) => void }} Robot */

const LONG = 800; // milliseconds until a press is a long one

/** Ids of the buttons pressed on the page or on a gamepad. */
export const pressed = signal(/** @type {ReadonlySet<number>} */ (new Set()));

/** Name of the gamepad in the browser, empty without one. */
export const gamepadName = signal("");
/** The chosen table, by id; null for the active one. */
export const chosenTable = signal(/** @type {number | null} */ (null));
/** Id of the button chosen on the screen. */
export const chosenButton = signal(1);

/** @param {string} name */
export function nameGamepad(name) {
  if (gamepadName.value !== name) gamepadName.value = name;
}

/** @param {number} id */
export function chooseButton(id) {
  chosenButton.value = id;
}

/** @param {number} id */
export function chooseTable(id) {
  chosenTable.value = id;
}

/** Turns buttons going down and up into macros. */
export class Presses {
  /** @param {Robot} robot */
  constructor(robot) {
    this._robot = robot;
    /** @type {Map<number, { timer: number, longEnds: number }>} */
    this._held = new Map();
    this._after = 0;
  }

  /**
   * A button goes down.
   * @param {number} id
   */
  press(id) {
    if (this._held.has(id)) return;
    this._held.set(id, { timer: setTimeout(() => this._long(id), LONG), longEnds: 0 });
    this._show();
    this._run(this._robot.button(id).button_press_macro);
  }

  /**
   * A button goes up.
   * @param {number} id
   */
  release(id) {
    const held = this._held.get(id),
      button = this._robot.button(id);
    if (held === undefined) return;
    clearTimeout(held.timer);
    this._held.delete(id);
    this._show();
    const rest = button.uninterruptible ? held.longEnds - performance.now() : 0;
    if (rest > 0) this._after = setTimeout(() => this._run(button.button_up_macro), rest);
    else this._run(button.button_up_macro);
  }

  /** Forget all pressed buttons, and the waiting macro: nothing more is started. */
  drop() {
    for (const { timer } of this._held.values()) clearTimeout(timer);
    clearTimeout(this._after);
    this._held.clear();
    this._show();
  }

  /** @param {number} id */
  _long(id) {
    const held = this._held.get(id),
      macroId = this._robot.button(id).button_long_press_macro;
    if (held === undefined || macroId === 0) return;
    held.longEnds = performance.now() + this._robot.seconds(macroId) * 1000;
    this._run(macroId);
  }

  /** @param {number} macroId */
  _run(macroId) {
    if (macroId === 0) return;
    clearTimeout(this._after); // another macro replaces the waiting one
    this._robot.run(macroId, this._robot.seconds(macroId));
  }

  _show() {
    pressed.value = new Set(this._held.keys());
  }
}
