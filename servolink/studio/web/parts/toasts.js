// Short messages: what was done, and how to undo it. Each goes away by itself.

import { html, signal } from "../html.js";
import { Icon } from "./icon.js";

/** A message takes the place of one with the same `name`, and `lasts` some milliseconds. */
/** @typedef {{ name?: string, lasts?: number, kind?: "ok" | "bad", icon?: string, title: string, detail?: string, action?: { label: string, run: () => void } }} Message */

const LASTS = 6000; // milliseconds
const MOST = 4;

const shown = signal(/** @type {(Message & { id: number })[]} */ ([]));
let lastId = 0;

/**
 * Show a message for some seconds.
 * @param {Message} message
 */
export function toast(message) {
  const id = ++lastId;
  const others = shown.value.filter(({ name }) => name === undefined || name !== message.name);
  shown.value = [...others, { ...message, id }].slice(-MOST);
  setTimeout(() => (shown.value = shown.value.filter((each) => each.id !== id)), message.lasts ?? LASTS);
}

export function Toasts() {
  return html`<div class="toasts" role="status" aria-live="polite">
    ${shown.value.map(
      (message) => html`<div key=${message.id} class="toast ${message.kind ?? ""}">
        <${Icon} name=${message.icon ?? (message.kind === "bad" ? "warn" : "check")} />
        <div class="grow">
          <b>${message.title}</b>
          ${message.detail && html`<p class="mut">${message.detail}</p>`}
        </div>
        ${message.action && html`<button class="btn s" onClick=${message.action.run}>${message.action.label}</button>`}
      </div>`,
    )}
  </div>`;
}
