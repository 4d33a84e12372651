// Text that is being typed into a field stays there, whatever else changes on the page meanwhile.

import { html, useEffect, useRef, useState } from "../html.js";
import { takesFocus } from "../state/focus.js";
import { mayEdit } from "../state/robot.js";

let unfinished = /** @type {EventTarget | null} */ (null);

/** Note the field with unfinished text, from now on. */
export function followTyping() {
  addEventListener("input", ({ target }) => (unfinished = target), { capture: true });
  for (const name of ["change", "focusout"]) addEventListener(name, finishTyping, { capture: true });
}

const finishTyping = () => void (unfinished = null);

/**
 * Return whether a field has unfinished text, for undo of the browser.
 * @param {EventTarget | null} target
 */
export const isUnfinished = (target) => target !== null && target === unfinished;

/**
 * Return the text of a field: `text`, or what is being typed, until `end` is called or the field is left; and the
 * handlers of the field.
 * @param {string} text
 */
export function useTyping(text) {
  const [typed, setTyped] = useState(/** @type {string | null} */ (null)),
    end = () => {
      finishTyping();
      setTyped(null);
    };
  /** @param {Event} event */
  const type = (event) => setTyped(/** @type {HTMLInputElement} */ (event.currentTarget).value);
  return { value: typed ?? text, end, handlers: { onInput: type, onBlur: end } };
}

/** From now on, enter the text in the focused field when the page is left, before edits are kept. */
export function enterOnLeave() {
  const enter = () => document.activeElement instanceof HTMLElement && document.activeElement.blur();
  addEventListener("pagehide", enter, { capture: true });
}

/**
 * The name of what the screen shows, as a field. `onChange` is called with another name, and returns the name that was kept.
 * @param {{ name: string, placeholder: string, label: string, onChange: (name: string) => string }} props
 */
export function NameField({ name, placeholder, label, onChange }) {
  const field = useRef(/** @type {HTMLInputElement | null} */ (null));
  const { value, end, handlers } = useTyping(name);
  useEffect(() => {
    if (takesFocus("name")) field.current?.select();
  }, []);
  /** @param {Event} event */
  const rename = (event) => {
    const field = /** @type {HTMLInputElement} */ (event.currentTarget);
    field.value = onChange(field.value.trim());
    end();
  };
  if (!mayEdit.value) return html`<h2 class="grow ell">${name || placeholder}</h2>`;
  return html`<input ref=${field} class="inp title" maxlength="32" value=${value} placeholder=${placeholder} aria-label=${label} onChange=${rename} ...${handlers} />`;
}
