// Icon beside a text with the same meaning, silent for screen readers.

import { html } from "../html.js";
import { ICONS } from "./icons.js";

/** @param {{ name: string }} props */
export function Icon({ name }) {
  return html`<svg class="i" viewBox="0 0 24 24" aria-hidden="true">
    ${ICONS[name].map(([Tag, attributes]) => html`<${Tag} ...${attributes} />`)}
  </svg>`;
}
