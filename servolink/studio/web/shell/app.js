// The page: header, screens, and what they need of the robot.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { StopButton, StopTools } from "../parts/stop-button.js";
import { shownScreen } from "../state/fleet.js";
import { hasBoard, hasFleet, welcome } from "../state/robot.js";
import { toasts } from "../state/toasts.js";
import { step } from "../state/tour.js";
import { showsKeys } from "../state/view.js";
import { t } from "../texts/text.js";
import { Unwritten } from "./edits.js";
import { Header } from "./header.js";
import { KeyList } from "./keys.js";
import { Notices } from "./notices.js";
import { Questions } from "./questions.js";
import { Dock, Rail } from "./rail.js";
import { useScreen } from "./screens.js";
import { Tour } from "./tour.js";

/** @typedef {import("../state/motion.js").Motion} Motion */
/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {{ link: Link, motion: Motion }} Tools */

/** @param {Tools} tools */
export function App(tools) {
  const name = shownScreen.value,
    Screen = useScreen(name),
    hasScreens = hasBoard.value || hasFleet.value;
  return html`<${StopTools.Provider} value=${tools}>
    <a class="skip" href="#main">${t("app.skip")}</a>
    <${Banner} />
    <${Header} ...${tools} />
    ${hasScreens && html`<${Rail} />`}
    <aside class="status" aria-label=${t("app.notices")}>
      <div class="notes">
        <${Questions} ...${tools} />
        <${Notices} ...${tools} />
        <div class="row"><${Tour} />${step.value === null && html`<${Unwritten} />`}</div>
      </div>
      <${Toasts} />
    </aside>
    <main id="main" tabindex="-1">
      <div class="screen">${Screen && html`<${Screen} key=${name} ...${tools} />`}</div>
    </main>
    ${hasScreens && html`<${Dock}><${StopButton} /></${Dock}>`}
    ${showsKeys.value && html`<${KeyList} />`}
  </${StopTools.Provider}>`;
}

function Toasts() {
  return html`<div class="toasts" role="status" aria-live="polite">
    ${toasts.value.map(
      (message) => html`<div key=${message.id} class="toast ${message.kind ?? ""}">
        <${Icon} name=${message.icon ?? (message.kind === "bad" ? "warn" : "check")} />
        <div class="grow">
          <b>${message.title}</b>
          ${message.detail && html`<p class="mut">${message.detail}</p>`}
        </div>
        ${message.action && html`<button class="btn s" onClick=${message.action.run}>${message.action.label}</button>`}
      </div>`,
    )}
  </div>`;
}

// Banner of a virtual board: nothing real moves. Nobody can close it.

function Banner() {
  if (!welcome.value?.is_virtual) return null;
  return html`<aside class="banner" aria-label=${t("banner.title")}>
    <${Icon} name="chip" /><b>${t("banner.title")}</b><span>${t("banner.nothing_moves")}</span>
    <span class="hide-n faint">${t("banner.connect")}</span>
  </aside>`;
}
