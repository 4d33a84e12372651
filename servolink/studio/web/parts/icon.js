// An icon beside a text that says the same, so that readers of the screen need not hear it.

import { html } from "../html.js";
import { ICONS } from "./icons.js";

/** @param {{ name: string }} props */
export function Icon({ name }) {
  return html`<svg class="i" viewBox="0 0 24 24" aria-hidden="true">
    ${ICONS[name].map(([Tag, attributes]) => html`<${Tag} ...${attributes} />`)}
  </svg>`;
}
