// Field for a number with its unit: accepts `0.5`, `0,5 s`, `−20°`; arrows change the number; Enter or a click elsewhere
// ends the input.

import { html, useRef } from "../html.js";
import { toast } from "../state/toasts.js";
import { t } from "../texts/text.js";
import { safeText } from "./safe-text.js";
import { useTyping } from "./typing.js";

/**
 * @typedef {object} Props
 * @property {number} value
 * @property {string} label
 * @property {(value: number) => string} format
 * @property {(value: number) => void} onChange called with a number from `low` to `high`
 * @property {number} [step] of an arrow; with Shift ten times as much
 * @property {number} [low]
 * @property {number} [high]
 * @property {string} [classes]
 * @property {boolean} [disabled]
 */

/** @param {Props} props */
export function NumberField({
  value,
  label,
  format,
  onChange,
  step = 1,
  low = -Infinity,
  high = Infinity,
  classes = "",
  disabled = false,
}) {
  const field = useRef(/** @type {HTMLInputElement | null} */ (null));
  const shown = format(value),
    typing = useTyping(shown);
  /** @param {number} number */
  const set = (number) => {
    const kept = Math.max(low, Math.min(high, number));
    if (kept !== value) onChange(kept);
    if (field.current) field.current.value = format(kept);
    typing.end();
  };
  const finish = () => {
    const text = field.current?.value ?? "",
      number = numberIn(text);
    typing.end();
    if (text === shown) return;
    if (number === null) {
      if (field.current) field.current.value = shown;
      say("field.no_number", { text: safeText(text), shown });
      return;
    }
    if (number < low) say("field.too_low", { text: safeText(text), shown: format(low) });
    if (number > high) say("field.too_high", { text: safeText(text), shown: format(high) });
    set(number);
  };
  /** @param {KeyboardEvent} event */
  const press = (event) => {
    if (event.key === "Enter") finish();
    const way = { ArrowUp: 1, ArrowDown: -1 }[event.key];
    if (way === undefined) return;
    event.preventDefault();
    set((numberIn(field.current?.value ?? "") ?? value) + way * step * (event.shiftKey ? 10 : 1));
  };
  return html`<input ref=${field} class="inp num ${classes}" inputmode="decimal" autocomplete="off" value=${typing.value} disabled=${disabled}
    aria-label=${label} onChange=${finish} onKeyDown=${press} onFocus=${() => field.current?.select()} ...${typing.handlers} />`;
}

/**
 * Say why a field does not take what was typed.
 * @param {"field.no_number" | "field.too_low" | "field.too_high"} key
 * @param {Record<string, string>} values
 */
const say = (key, values) => toast({ name: "field", kind: "bad", title: t(key, values) });

/**
 * Return the number at the beginning of a text, or null.
 * @param {string} text
 */
export function numberIn(text) {
  const found = text
    .trim()
    .replace("\u2212", "-")
    .replace(",", ".")
    .match(/^[-+]?(\d+\.?\d*|\.\d+)/);
  return found ? Number(found[0]) : null;
}
