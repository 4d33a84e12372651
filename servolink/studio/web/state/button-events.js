// What the board says of the buttons of its remote control.

import { batch, signal } from "../html.js";

/** @typedef {"press" | "long_press" | "up"} ButtonKind */
/** @typedef {{ number: number, id: number, kind: string, time: Date }} ButtonEvent */

const MOST = 100;

/** The ids of the buttons that are down. */
export const down = signal(/** @type {ReadonlySet<number>} */ (new Set()));
/** The latest events, the newest first. */
export const heard = signal(/** @type {ButtonEvent[]} */ ([]));
/** How many events came, and how many must have been lost: those without which the others make no sense. */
export const counts = signal({ heard: 0, lost: 0 });

/** The buttons of which at least one event came: of the others it is not known whether they are down. */
const known = /** @type {Set<number>} */ (new Set());

/** Forget which buttons are down: the connection is new, and events may have been missed. */
export function forgetButtons() {
  known.clear();
  down.value = new Set();
}

/**
 * Take an event.
 * @param {{ button_id: number, kind: string }} event
 */
export function hear({ button_id: id, kind }) {
  const wasDown = down.value.has(id),
    isDown = kind !== "up";
  const isOdd = known.has(id) && wasDown === (kind === "press");
  known.add(id);
  batch(() => {
    const after = new Set(down.value);
    if (isDown) after.add(id);
    else after.delete(id);
    down.value = after;
    counts.value = { heard: counts.value.heard + 1, lost: counts.value.lost + Number(isOdd) };
    heard.value = [{ number: counts.value.heard, id, kind, time: new Date() }, ...heard.value].slice(0, MOST);
  });
}
