// All actions as pictures of their poses.

import { html, useEffect, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { tooFast } from "../../state/edit-action.js";
import { nameOf } from "../../state/figure.js";
import { capOf } from "../../state/limits.js";
import { draft } from "../../state/project.js";
import { poseOf, secondsOf } from "../../state/records.js";
import { chooseAction } from "../../state/view.js";
import { seconds, t } from "../../texts/text.js";
import { addTaken } from "./commands.js";
import { action, actionBefore, nameOfAction, searchActions, searchText, startPose } from "../../state/shown-action.js";

/** @typedef {import("../../state/records.js").Action} Action */

export function PoseList() {
  const actions = draft.value?.actions ?? [],
    list = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => {
    list.current?.querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }, [action.value?.action_id]);
  return html`<section class="card list" aria-label=${t("screen.actions")}>
    <header>
      <h2>${t("screen.actions")} <span class="mut num count">${actions.length}</span></h2>
      <button class="btn s ic" aria-label=${t("actions.new")} title=${t("actions.new")} onClick=${addTaken}><${Icon} name="plus" /></button>
    </header>
    <div class="find hide-n">
      <input class="inp s" type="search" value=${searchText.value} placeholder=${t("actions.find")} aria-label=${t("actions.find")}
        onInput=${(/** @type {Event} */ event) => searchActions(/** @type {HTMLInputElement} */ (event.currentTarget).value)} />
    </div>
    <div class="poses" ref=${list}>${actions.filter(isWanted).map((one) => html`<${Tile} key=${one.action_id} one=${one} />`)}</div>
  </section>`;
}

/** @param {{ one: Action }} props */
function Tile({ one }) {
  const previous = actionBefore(one);
  const isFast = previous !== null && tooFast(one, startPose(previous), capOf).length > 0;
  return html`<button class="pose" aria-pressed=${String(one === action.value)} onClick=${() => chooseAction(one.action_id)}>
    <${PosePicture} pose=${poseOf(one)} />
    ${isFast && html`<span class="wn" role="img" aria-label=${t("actions.too_fast")} title=${t("actions.too_fast")}><${Icon} name="warn" /></span>`}
    <div>
      <b class="ell">${nameOfAction(one)}</b>
      <small class="num">${t("actions.facts", { time: seconds(secondsOf(one), 1), count: one.steps.length })}</small>
    </div>
  </button>`;
}

/** @param {Action} one */
function isWanted(one) {
  const text = searchText.value.trim().toLowerCase();
  const servos = one.steps.flatMap((step) => [String(step.servo_id), nameOf(step.servo_id).toLowerCase()]);
  return text === "" || nameOfAction(one).toLowerCase().includes(text) || servos.some((servo) => servo.includes(text));
}
