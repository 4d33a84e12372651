// Fleet: a tile for each board at the broker, those that need help first, and runs on several boards.

import { html, useEffect, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { broker, fleetProblem, needing, pick, picked, readGroups, shownTiles, tiles } from "../../state/fleet.js";
import { isLocalEditor } from "../../state/robot.js";
import { said } from "../../texts/said.js";
import { t } from "../../texts/text.js";
import { RunCard } from "./run.js";

/** @typedef {import("../../state/fleet.js").Tile} Tile */

const MOST = 400; // tiles on the page at once
const LOW = 20; // percent of the charge of a battery

/** @param {{ link: import("../../link/link.js").Link }} props */
export function FleetScreen({ link }) {
  const [text, setText] = useState(""),
    [onlyNeeding, setOnlyNeeding] = useState(false);
  useEffect(() => void readGroups(link), []);
  const shown = shownTiles(tiles.value.values(), { text, onlyNeeding: onlyNeeding && needing.value > 0 });
  const online = [...tiles.value.values()].filter(({ state }) => state !== "offline").length;
  return html`<div class="fleet">
    <header class="row wrap">
      <h1>${t("fleet.title")}</h1>
      <span class="chip num">${t("fleet.connected", { count: online, all: tiles.value.size })}</span>
      ${needing.value > 0 && html`<button class="btn s needing" aria-pressed=${String(onlyNeeding)} onClick=${() => setOnlyNeeding(!onlyNeeding)}><${Icon} name="warn" />${t("fleet.need_help", { count: needing.value })}</button>`}
      <label class="grow"><span class="sr">${t("fleet.search")}</span>
        <input class="inp" type="search" maxlength="100" placeholder=${t("fleet.search")} value=${text}
          onInput=${(/** @type {Event} */ event) => setText(/** @type {HTMLInputElement} */ (event.currentTarget).value)} /></label>
    </header>
    ${!broker.value.isConnected && html`<${Note} kind="bad" urgent title=${t("fleet.broker_lost", { broker: safeText(broker.value.address) })} detail=${t("fleet.broker_lost_detail")} />`}
    ${fleetProblem.value && html`<${Note} kind="warn" urgent title=${safeText(fleetProblem.value)} />`}
    ${isLocalEditor.value && tiles.value.size > 0 && html`<${RunCard} link=${link} shown=${shown} />`}
    <ul class="tiles" aria-label=${t("fleet.boards")}>
      ${shown.slice(0, MOST).map((tile) => html`<${Board} key=${tile.name} tile=${tile} isPicked=${picked.value.has(tile.name)} />`)}
    </ul>
    ${shown.length > MOST && html`<p class="mut">${t("fleet.more", { count: shown.length - MOST })}</p>`}
    ${tiles.value.size === 0 && html`<div class="empty"><${Icon} name="fleet" /><p>${t("fleet.none")}</p><code>servolink fleet join ${safeText(broker.value.address)}</code></div>`}
  </div>`;
}

/** @param {{ tile: Tile, isPicked: boolean }} props */
function Board({ tile, isPicked }) {
  const { name, state, urgency, battery_percent: battery } = tile;
  const canPick = isLocalEditor.value && tile.may_run;
  const by = tile.hold || tile.lease;
  const problems = tile.problems.map(said).map(safeText).join("\n");
  return html`<li><label class="tile u${urgency} ${state === "offline" ? "off" : ""}">
    <span class="row">
      ${canPick && html`<input type="checkbox" aria-label=${name} checked=${isPicked} onChange=${() => pick([name])} />`}
      <b class="grow ell">${name}</b>
      ${battery !== null && html`<span class=${battery < LOW ? "chip num bad" : "chip num"}>${Math.round(battery)} %</span>`}
      ${state !== "ready" && html`<span class=${state === "offline" ? "chip" : "chip bad"}>${t(`fleet.${state}`)}</span>`}
    </span>
    <small class="ell mut">${safeText(tile.host)}</small>
    ${by && html`<small class="ell by"><${Icon} name="hand" />${t(tile.hold ? "fleet.held_by" : "fleet.moved_by", { who: safeText(said(by)) })}</small>`}
    ${problems && html`<small class="problems" title=${problems}>${problems}</small>`}
  </label></li>`;
}
