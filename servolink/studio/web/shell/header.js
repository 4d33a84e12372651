// The header: board, who has control, and STOP at the edge.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { safeText } from "../parts/safe-text.js";
import { StopButton } from "../parts/stop-button.js";
import { failure, loading } from "../state/loading.js";
import { battery, boardState, hasBoard, hasFleet, linkState, welcome } from "../state/robot.js";
import { changeTheme, theme } from "../state/settings.js";
import { showKeys } from "../state/view.js";
import { t } from "../texts/text.js";
import { Control } from "./control.js";
import { Edits } from "./edits.js";
import { LanguageChoice } from "./language-choice.js";

/** @typedef {import("./app.js").Tools} Tools */

const LOW = 20,
  FULL = 100; // percent

/** @param {Tools} tools */
export function Header(tools) {
  const onWide = hasBoard.value || hasFleet.value ? "hide-n" : ""; // the list beside STOP has it on phones
  return html`<header class="head">
    <div class="logo hide-n"><${Logo} /></div>
    <${BoardName} />
    <${Edits} />
    <div class="headright">
      <${BatteryChip} />
      <${Control} ...${tools} />
      <span class="btn ic ghost ${onWide}"><${LanguageChoice} /></span>
      <button class="btn ic ghost" aria-label=${t("app.theme")} onClick=${changeTheme}>
        <${Icon} name=${theme.value === "dark" ? "sun" : "moon"} />
      </button>
      <button class="btn ic ghost ${onWide}" aria-label=${t("app.keys")} onClick=${() => showKeys(true)}>
        <${Icon} name="help" />
      </button>
      <${StopButton} />
    </div>
  </header>`;
}

function BoardName() {
  const isLost = linkState.value !== "open" || boardState.value !== "connected";
  const dot = isLost ? "dot lost" : hasBoard.value ? "dot" : "dot off";
  const name = safeText(welcome.value?.name ?? "") || t("app.title");
  return html`<a class="boardbtn" href="#board" title=${t("screen.board")}>
    <span class=${dot}></span>
    <span class="grow"><b class="ell">${name}</b><small class="num ell">${place()}</small></span>
  </a>`;
}

function BatteryChip() {
  if (battery.value === null) return null;
  const percent = Math.round(battery.value),
    isDoubtful = percent > FULL;
  return html`<span class=${percent < LOW || isDoubtful ? "chip num bad" : "chip num"} title=${isDoubtful ? t("live.doubtful") : t("board.battery")}>
    <${Icon} name="battery" />${percent} %${isDoubtful ? " ?" : ""}
  </span>`;
}

function place() {
  if (failure.value) return t("board.not_loaded");
  if (linkState.value === "connecting") return connecting();
  if (linkState.value === "refused") return t("board.refused");
  if (linkState.value === "unshared") return t("board.unshared");
  if (linkState.value !== "open") return t("board.studio_lost");
  if (!hasBoard.value) return t("robots.no_robot");
  if (boardState.value !== "connected") return t("board.lost");
  return welcome.value?.is_virtual ? t("board.in_this_computer") : safeText(welcome.value?.url ?? "");
}

const Logo = () => html`<svg viewBox="0 0 32 32" aria-hidden="true">
  <rect class="logo-ground" width="32" height="32" rx="9" />
  <circle class="logo-line" cx="11" cy="21" r="3.4" />
  <path class="logo-line" d="M13.6 18.6 21 11.4" />
  <circle class="logo-glow" cx="22.4" cy="10" r="2.6" />
</svg>`;

const MEGABYTE = 1e6;

/** What the page waits for: the studio, or Python that is loaded into the page. */
function connecting() {
  if (!loading.value) return t("board.connecting");
  const { loaded, total } = loading.value;
  return t("board.loading", { loaded: (loaded / MEGABYTE).toFixed(1), total: (total / MEGABYTE).toFixed(1) });
}
