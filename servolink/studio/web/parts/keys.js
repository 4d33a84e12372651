// Keys of one screen.

import { useEffect } from "../html.js";
import { isTyping } from "./hold.js";

/**
 * Call the function for each key that goes into no text field, while the screen is shown. Keys are named as in `m`,
 * `Control+d`, `Alt+ArrowLeft`.
 * @param {Record<string, (event: KeyboardEvent) => void>} keys
 */
export function useKeys(keys) {
  useEffect(() => {
    /** @param {KeyboardEvent} event */
    const press = (event) => {
      if (isTyping(event.target) || event.defaultPrevented || document.querySelector("dialog[open]")) return;
      const does = keys[nameOf(event)];
      if (does === undefined || (event.key === " " && isButton(event.target))) return;
      event.preventDefault();
      does(event);
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  });
}

/** @param {KeyboardEvent} event */
function nameOf(event) {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  return `${event.ctrlKey || event.metaKey ? "Control+" : ""}${event.altKey ? "Alt+" : ""}${key}`;
}

/** @param {EventTarget | null} target */
const isButton = (target) => target instanceof Element && target.matches("button, a, summary, input");
