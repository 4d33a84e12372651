// Short messages about what was done, with a button to undo it. A message disappears after some seconds.

import { signal } from "../html.js";
import { t } from "../texts/text.js";
import { undo, undoLabel } from "./project.js";

/** A message takes the place of one with the same `name`, and `lasts` some milliseconds. */
/** @typedef {{ name?: string, lasts?: number, kind?: "ok" | "bad", icon?: string, title: string, detail?: string, action?: { label: string, run: () => void } }} Message */

const LASTS = 6000; // milliseconds
const MOST = 4;

/** The messages on the screen. */
export const toasts = signal(/** @type {(Message & { id: number })[]} */ ([]));
let lastId = 0;

/**
 * Show a message for some seconds.
 * @param {Message} message
 */
export function toast(message) {
  const id = ++lastId;
  const others = toasts.peek().filter(({ name }) => name === undefined || name !== message.name);
  toasts.value = [...others, { ...message, id }].slice(-MOST);
  setTimeout(() => (toasts.value = toasts.value.filter((each) => each.id !== id)), message.lasts ?? LASTS);
}

/**
 * Show the effect of the latest edit, with a button to undo the edit. After later edits the button does nothing.
 * @param {{ icon?: string, title: string, detail?: string }} message
 */
export function editToast(message) {
  const label = undoLabel.peek();
  const run = () => undoLabel.peek() === label && undo();
  toast({ name: "edit", ...message, action: { label: t("edit.undo"), run } });
}
