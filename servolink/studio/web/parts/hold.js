// Button that acts as long as held, by a finger, the mouse, Space, or the key H anywhere.

import { html, useEffect, useRef, useState } from "../html.js";
import { Icon } from "./icon.js";

/**
 * @typedef {object} Props
 * @property {string} label
 * @property {string} [room] longest text of the button
 * @property {string} [hint]
 * @property {boolean} [disabled]
 * @property {boolean} [hasKey] whether the key H holds the button too
 * @property {string} [classes]
 * @property {() => void} onBegin
 * @property {() => void} onEnd
 */

const KEY = "h";

/** @param {Props} props */
export function Hold({
  label,
  room = label,
  hint = "",
  disabled = false,
  hasKey = true,
  classes = "",
  onBegin,
  onEnd,
}) {
  const [isHeld, setHeld] = useState(false);
  const held = useRef(false);
  const begin = () => {
    if (disabled || held.current) return;
    held.current = true;
    setHeld(true);
    onBegin();
  };
  const end = () => {
    if (!held.current) return;
    held.current = false;
    setHeld(false);
    onEnd();
  };
  useHeldKey(begin, end, disabled || !hasKey);
  useEffect(() => (disabled ? end() : undefined), [disabled]);
  useEffect(() => end, []);
  /** @param {PointerEvent} event */
  const grab = (event) => {
    if (event.button !== 0) return;
    /** @type {Element} */ (event.currentTarget).setPointerCapture(event.pointerId);
    begin();
  };
  /** @param {KeyboardEvent} event */
  const press = (event) => {
    if (event.key !== " " && event.key !== "Enter") return;
    event.preventDefault();
    begin();
  };
  return html`<button
    class="hold ${isHeld ? "on" : ""} ${classes}"
    disabled=${disabled}
    title=${hint}
    aria-pressed=${String(isHeld)}
    onPointerDown=${grab}
    onPointerUp=${end}
    onPointerCancel=${end}
    onLostPointerCapture=${end}
    onKeyDown=${press}
    onKeyUp=${end}
    onBlur=${end}
    onContextMenu=${(/** @type {Event} */ event) => event.preventDefault()}
  >
    <${Icon} name="hand" /><span data-room=${room}>${label}</span>
  </button>`;
}

/**
 * Call `begin` while H is down outside of text fields, and `end` when it is up or the page is left.
 * @param {() => void} begin
 * @param {() => void} end
 * @param {boolean} disabled
 */
function useHeldKey(begin, end, disabled) {
  useEffect(() => {
    const ends = new AbortController(),
      options = { signal: ends.signal };
    addEventListener(
      "keydown",
      (event) => {
        const isPlain = !event.repeat && !event.ctrlKey && !event.metaKey && !event.altKey;
        if (event.key.toLowerCase() === KEY && isPlain && !isTyping(event.target)) begin();
      },
      options,
    );
    addEventListener(
      "keyup",
      (event) => {
        if (event.key.toLowerCase() === KEY) end();
      },
      options,
    );
    addEventListener("blur", end, options);
    document.addEventListener("visibilitychange", end, options);
    return () => ends.abort();
  }, [disabled, begin, end]);
}

/**
 * Return whether a key goes into a text field.
 * @param {EventTarget | null} target
 */
export function isTyping(target) {
  return target instanceof Element && target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");
}
