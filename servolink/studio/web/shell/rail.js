// The screens: a rail at the side, or a bar at the bottom of a phone.

import { html, useEffect, useRef, useState } from "../html.js";
import { Icon } from "../parts/icon.js";
import { isInPage } from "../state/connecting.js";
import { needing, shownScreen } from "../state/fleet.js";
import { differences } from "../state/project.js";
import { hasBoard, hasFleet, mayEdit, mayMove, welcome } from "../state/robot.js";
import { screen, showKeys, showScreen } from "../state/view.js";
import { t } from "../texts/text.js";
import { LanguageChoice } from "./language-choice.js";

/** @typedef {{ name: string, icon: string, title: import("../texts/text.js").Key, isBelow?: boolean }} Entry */

/** Programs in Python: beside a studio with a server there are terminals and editors. @type {Entry} */
const CODE = { name: "code", icon: "code", title: "screen.code" };

/** In the order of the rail and of the keys 1 to 9. @type {Entry[]} */
export const ENTRIES = [
  { name: "live", icon: "live", title: "screen.live" },
  { name: "actions", icon: "actions", title: "screen.actions" },
  { name: "macros", icon: "macros", title: "screen.macros" },
  { name: "buttons", icon: "buttons", title: "screen.buttons" },
  { name: "teach", icon: "teach", title: "screen.teach" },
  { name: "blocks", icon: "blocks", title: "screen.blocks" },
  ...(isInPage ? [CODE] : []),
  { name: "record", icon: "record", title: "screen.record" },
  { name: "project", icon: "project", title: "screen.project", isBelow: true },
  { name: "board", icon: "board", title: "screen.board", isBelow: true },
  { name: "servos", icon: "grid", title: "screen.servos", isBelow: true },
  { name: "fleet", icon: "fleet", title: "screen.fleet", isBelow: true },
];

/** Return the screens of this page: without a board its choice and the fleet, and none for moving if it may not move. */
export const entries = () =>
  ENTRIES.filter(({ name }) => {
    if (name === "fleet") return hasFleet.value;
    if (name === "blocks" || name === "code") return hasBoard.value && (welcome.value === null || mayEdit.value);
    if (name === "teach" || name === "servos") return hasBoard.value && (welcome.value === null || mayMove.value);
    return hasBoard.value || name === "board";
  });

/** Links to all screens, at the side or below. */
export function Rail() {
  return html`<nav class="rail" aria-label=${t("app.screens")}>${entries().map((entry) => link(entry))}</nav>`;
}

const MOST = 4; // screens in the bar of a phone, beside STOP; a list has the others

/** @param {{ children?: any }} props */
export function Dock({ children }) {
  return html`<nav class="dock" aria-label=${t("app.screens")}>${entries()
    .slice(0, MOST)
    .map((entry) => link(entry))}<${Others} />${children}</nav>`;
}

/** Button for the other screens, marked and named as the present one if that is among them; also language and help. */
function Others() {
  const [openedOn, setOpenedOn] = useState(/** @type {string | null} */ (null));
  const isOpen = openedOn === screen.value; // an effect would close the list after the drawing of the screen
  const box = useRef(/** @type {HTMLElement | null} */ (null));
  const others = entries().slice(MOST);
  const present = others.find(isShown);
  const label = present ? `${t(present.title)}, ${t("app.more")}` : t("app.more");
  const close = () => setOpenedOn(null);
  useEffect(() => {
    if (!isOpen) return undefined;
    const leave = (/** @type {Event} */ event) => {
      if (!box.current?.contains(/** @type {Node} */ (event.target))) close();
    };
    for (const name of ["pointerdown", "focusin"]) addEventListener(name, leave);
    return () => {
      for (const name of ["pointerdown", "focusin"]) removeEventListener(name, leave);
    };
  }, [isOpen]);
  /** @param {() => void} act */
  const then = (act) => () => {
    close();
    act();
  };
  return html`<span class="others" ref=${box}>
    <button class="m" aria-expanded=${String(isOpen)} aria-current=${present ? "page" : undefined} aria-label=${label} onClick=${() => setOpenedOn(isOpen ? null : screen.value)}>
      <${Icon} name=${present?.icon ?? "more"} /><span>${t(present?.title ?? "app.more")}</span>
    </button>
    ${
      isOpen &&
      html`<div class="otherlist card">
      ${others.map((entry) => link(entry, close))}
      <span class="m"><${LanguageChoice} /><span aria-hidden="true">${t("app.language")}</span></span>
      <button class="m" onClick=${then(() => showKeys(true))}><${Icon} name="help" /><span>${t("app.help")}</span></button>
    </div>`
    }
  </span>`;
}

/** @param {Entry} entry */
const isShown = ({ name }) => name === (shownScreen.value === "start" ? "board" : shownScreen.value);

/**
 * @param {Entry} entry
 * @param {() => void} [onClick]
 */
const link = (
  entry,
  onClick,
) => html`<a href="#${entry.name}" onClick=${onClick} class=${entry.isBelow ? "below" : ""} aria-current=${isShown(entry) ? "page" : undefined}>
  <${Icon} name=${entry.icon} /><span>${t(entry.title)}</span>
  ${entry.name === "fleet" && needing.value > 0 && html`<span class="badge warn num" title=${t("fleet.need_help", { count: needing.value })}>${needing.value}</span>`}
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
