// A button that opens a short list of things to do.

import { html, useEffect, useRef, useState } from "../html.js";
import { Icon } from "./icon.js";

/** @typedef {{ label: string, run: () => void, danger?: boolean }} Item */

/** @param {{ label: string, items: Item[] }} props */
export function Menu({ label, items }) {
  const [isOpen, setOpen] = useState(false);
  const box = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => {
    if (!isOpen) return undefined;
    /** @type {HTMLElement | null | undefined} */ (box.current?.querySelector("[role=menuitem]"))?.focus();
    const leave = (/** @type {Event} */ event) => {
      if (!box.current?.contains(/** @type {Node} */ (event.target))) setOpen(false);
    };
    addEventListener("pointerdown", leave);
    addEventListener("focusin", leave);
    return () => {
      removeEventListener("pointerdown", leave);
      removeEventListener("focusin", leave);
    };
  }, [isOpen]);
  /** @param {KeyboardEvent} event */
  const press = (event) => {
    if (event.key === "Escape") setOpen(false);
    const way = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (way === undefined) return;
    event.preventDefault();
    const all = [.../** @type {HTMLElement} */ (box.current).querySelectorAll("[role=menuitem]")];
    const next = all[(all.indexOf(/** @type {Element} */ (document.activeElement)) + way + all.length) % all.length];
    /** @type {HTMLElement} */ (next).focus();
  };
  /** @param {Item} item */
  const choose = (item) => {
    setOpen(false);
    item.run();
  };
  return html`<span class="menu" ref=${box}>
    <button class="btn ic" aria-label=${label} aria-haspopup="menu" aria-expanded=${String(isOpen)} onClick=${() => setOpen(!isOpen)}>
      <${Icon} name="more" />
    </button>
    ${
      isOpen &&
      html`<div class="menulist card" role="menu" aria-label=${label} onKeyDown=${press}>
      ${items.map((item) => html`<button role="menuitem" class=${item.danger ? "danger" : ""} onClick=${() => choose(item)}>${item.label}</button>`)}
    </div>`
    }
  </span>`;
}
