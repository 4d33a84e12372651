// The screens: a rail at the side, or a bar at the bottom of a phone.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { differences } from "../state/project.js";
import { screen, showScreen } from "../state/view.js";
import { t } from "../texts/text.js";

/** @typedef {{ name: string, icon: string, title: import("../texts/text.js").Key, isBelow?: boolean }} Entry */

/** In the order of the rail and of the keys 1 to 9. @type {Entry[]} */
export const ENTRIES = [
  { name: "live", icon: "live", title: "screen.live" },
  { name: "actions", icon: "actions", title: "screen.actions" },
  { name: "macros", icon: "macros", title: "screen.macros" },
  { name: "buttons", icon: "buttons", title: "screen.buttons" },
  { name: "teach", icon: "teach", title: "screen.teach" },
  { name: "record", icon: "record", title: "screen.record" },
  { name: "project", icon: "project", title: "screen.project", isBelow: true },
  { name: "board", icon: "board", title: "screen.board", isBelow: true },
  { name: "servos", icon: "grid", title: "screen.servos", isBelow: true },
];

/** Links to all screens, at the side or below. */
export function Rail() {
  return html`<nav class="rail" aria-label=${t("app.screens")}>${ENTRIES.map(link)}</nav>`;
}

/** @param {{ children?: any }} props */
export function Dock({ children }) {
  return html`<nav class="dock" aria-label=${t("app.screens")}>${ENTRIES.map(link)}${children}</nav>`;
}

/** @param {Entry} entry */
const link = (
  entry,
) => html`<a href="#${entry.name}" class=${entry.isBelow ? "below" : ""} aria-current=${entry.name === screen.value ? "page" : undefined}>
  <${Icon} name=${entry.icon} /><span>${t(entry.title)}</span>
  ${entry.name === "project" && differences.value.length > 0 && html`<span class="badge num" title=${t("edit.not_written", { count: differences.value.length })}>${differences.value.length}</span>`}
</a>`;

/** Follow the part of the address behind `#` from now on. */
export function followAddress() {
  const read = () => {
    const name = location.hash.slice(1);
    if (ENTRIES.some((entry) => entry.name === name)) showScreen(name);
  };
  addEventListener("hashchange", read);
  read();
}
