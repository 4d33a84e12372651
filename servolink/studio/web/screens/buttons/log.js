// What the board said of its buttons, the newest first, and how much of that was lost.

import { html } from "../../html.js";
import { counts, heard } from "../../state/button-events.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../texts/text.js").Key} Key */

const SHOWN = 4;

/** @type {Record<string, Key>} */
const TITLES = { press: "buttons.press", long_press: "buttons.long_press", up: "buttons.up" };

export function EventCount() {
  const { heard: count, lost } = counts.value;
  if (count === 0) return html`<span class="mut">${t("buttons.no_events")}</span>`;
  if (lost > 0) return html`<span class="chip warn num">${t("buttons.events_lost", { count, lost })}</span>`;
  return html`<span class="mut num">${t("buttons.events", { count })}</span>`;
}

/** @param {{ macroOf: (id: number, kind: string) => string }} props */
export function EventLog({ macroOf }) {
  const shown = heard.value.slice(0, SHOWN);
  return html`<div class="pad0">
    <h2 class="h3">${t("buttons.log")}</h2>
    <div role="log"><ul class="log">
      ${shown.map(({ number, id, kind, time }) => {
        const macro = macroOf(id, kind);
        return html`<li key=${number}>
          <time>${time.toTimeString().slice(0, 8)}</time><span class="sid acc">${id}</span>
          <span>${kind in TITLES ? t(TITLES[kind]) : kind}</span><span class="grow mut ell">${macro && `→ ${macro}`}</span>
        </li>`;
      })}
      ${shown.length === 0 && html`<li class="mut">${t("buttons.log_empty")}</li>`}
    </ul></div>
  </div>`;
}
