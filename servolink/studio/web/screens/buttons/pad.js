// The gamepad, drawn. Buttons that do something are tinted and carry the name of their macro.

import { html, useLayoutEffect, useRef } from "../../html.js";
import { t } from "../../texts/text.js";
import { PLACES } from "./layout.js";

/** @typedef {import("./layout.js").Place} Place */
/**
 * State of each button for a drawing of them, and handlers of presses.
 * @typedef {object} Shown
 * @property {number} chosen
 * @property {(id: number) => boolean} isSet
 * @property {(id: number) => boolean} isDown
 * @property {(id: number) => string} caption of the button
 * @property {(id: number) => string} macro name of the macro that it starts
 * @property {(id: number) => void} onPress
 * @property {(id: number) => void} onRelease
 */

const BODY =
  "M245 82h360c90 0 150 40 168 120 16 72 26 190-32 204-48 12-78-44-112-84-10-12-22-16-38-16H259c-16 0-28 4-38 16-34 " +
  "40-64 96-112 84-58-14-48-132-32-204 18-80 78-120 168-120Z";
const STICKS = [325, 525];
const ROOM = { above: 190, below: 190, left: 122, right: 122, menu: 66 }; // per name, so that names do not overlap
const MOST_CHARACTERS = 40;
const FROM_CENTRE = { round: [32, 38, 30], shoulder: [70, 34, 26], menu: [30, 28, 20] }; // aside, below, above

/** @param {Shown} props */
export function Pad(props) {
  return html`<svg class="padsvg" viewBox="0 20 850 410" preserveAspectRatio="xMidYMid meet" role="group" aria-label=${t("buttons.pad")}>
    <path class="body" d=${BODY} />
    ${STICKS.map((x) => html`<circle class="stick" cx=${x} cy="250" r="44" /><circle class="stick" cx=${x} cy="250" r="26" />`)}
    ${PLACES.map((place) => html`<${PadButton} key=${place.id} place=${place} ...${props} />`)}
  </svg>`;
}

/** @param {{ place: Place } & Shown} props */
function PadButton({ place, chosen, isSet, isDown, caption, macro, onPress, onRelease }) {
  const { id, x, y } = place;
  const classes = ["b", isSet(id) && "set", chosen === id && "sel", isDown(id) && "down"].filter(Boolean).join(" ");
  return html`<g class=${classes} tabindex="0" role="button" aria-pressed=${String(chosen === id)}
    aria-label=${nameOf(t("buttons.button", { id }), macro(id), caption(id))}
    ...${pressing(id, onPress, onRelease)}>
    <${Shape} ...${place} />
    <text class="num" x=${x} y=${y + 5}>${id}</text>${" "}
    ${macro(id) && html`<${Label} place=${place} text=${macro(id)} />`}
  </g>`;
}

/**
 * Return the name of a button; it begins with the text on the button.
 * @param {string[]} parts
 */
const nameOf = (...parts) => [...new Set(parts)].filter(Boolean).join(", ");

/** @param {Place} place */
function Shape({ x, y, shape }) {
  if (shape === "round") return html`<circle class="k" cx=${x} cy=${y} r="24" />`;
  if (shape === "menu") return html`<rect class="k" x=${x - 22} y=${y - 12} width="44" height="24" rx="12" />`;
  return html`<rect class="k" x=${x - 62} y=${y - 17} width="124" height="34" rx="15" />`;
}

/** @param {{ place: Place, text: string }} props */
function Label({ place: { x, y, shape, label = "below" }, text }) {
  const drawn = useRef(/** @type {SVGTextElement | null} */ (null)),
    room = shape === "menu" ? ROOM.menu : ROOM[label];
  useLayoutEffect(() => fit(/** @type {SVGTextElement} */ (drawn.current), text, room), [text]);
  const [aside, below, above] = FROM_CENTRE[shape];
  if (label === "left") return html`<text ref=${drawn} class="lab end" x=${x - aside} y=${y + 4}>${text}</text>`;
  if (label === "right") return html`<text ref=${drawn} class="lab start" x=${x + aside} y=${y + 4}>${text}</text>`;
  return html`<text ref=${drawn} class="lab" x=${x} y=${label === "above" ? y - above : y + below}>${text}</text>`;
}

/**
 * Draw as much of a text as there is room for.
 * @param {SVGTextElement} drawn
 * @param {string} text
 * @param {number} room
 */
function fit(drawn, text, room) {
  const content = /** @type {Text} */ (drawn.firstChild),
    characters = [...text.slice(0, MOST_CHARACTERS)];
  if (text.length > MOST_CHARACTERS) content.data = `${characters.join("")}\u2026`;
  while (characters.length > 0 && drawn.getComputedTextLength() > room) {
    characters.pop();
    content.data = `${characters.join("")}\u2026`;
  }
}

/**
 * Return the handlers for pointer and keys of a button.
 * @param {number} id
 * @param {(id: number) => void} onPress
 * @param {(id: number) => void} onRelease
 */
export function pressing(id, onPress, onRelease) {
  const release = () => onRelease(id);
  return {
    onPointerDown: (/** @type {PointerEvent} */ event) => {
      if (event.button !== 0) return;
      /** @type {Element} */ (event.currentTarget).setPointerCapture(event.pointerId);
      onPress(id);
    },
    onPointerUp: release,
    onPointerCancel: release,
    onLostPointerCapture: release,
    onBlur: release,
    onContextMenu: (/** @type {Event} */ event) => event.preventDefault(),
    onKeyDown: (/** @type {KeyboardEvent} */ event) => {
      if (event.key !== " " && event.key !== "Enter") return;
      event.preventDefault();
      if (!event.repeat) onPress(id);
    },
    onKeyUp: release,
  };
}
