// Row of buttons with a single choice.

import { html } from "../html.js";
import { Icon } from "./icon.js";

/** @typedef {{ value: string, label: string, icon?: string }} Choice */

/** @param {{ label: string, choices: Choice[], value: string, onChoose: (value: any) => void, small?: boolean }} props */
export function Segments({ label, choices, value, onChoose, small = false }) {
  return html`<div class=${small ? "seg s" : "seg"} role="group" aria-label=${label}>
    ${choices.map(
      (choice) => html`<button
        key=${choice.value}
        aria-pressed=${String(choice.value === value)}
        onClick=${() => onChoose(choice.value)}
      >
        ${choice.icon && html`<${Icon} name=${choice.icon} />`}${choice.label}
      </button>`,
    )}
  </div>`;
}
