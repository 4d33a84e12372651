// Events of the buttons of the remote control, as the board reports them.

import { batch, signal } from "../html.js";

/** @typedef {"press" | "long_press" | "up"} ButtonKind */
/** @typedef {{ number: number, id: number, kind: string, time: Date }} ButtonEvent */

const MOST = 100;

/** The ids of the buttons that are down. */
export const down = signal(/** @type {ReadonlySet<number>} */ (new Set()));
/** The latest events, the newest first. */
export const heard = signal(/** @type {ButtonEvent[]} */ ([]));
/** Number of events, and of lost events: a second press without a release between them means a lost one. */
export const counts = signal({ heard: 0, lost: 0 });

/** Buttons with at least one event: no other button is known to be up or down. */
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
