// Actions: poses as pictures, the figure as their editor, and every servo with its target and its time.

import { html, useEffect, useRef, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { NumberField } from "../../parts/number-field.js";
import { PasteButton } from "../../parts/paste-button.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { useVerdicts, VerdictMark } from "../../parts/twin.js";
import { Reading } from "../../parts/reading.js";
import { tooFast } from "../../state/edit-action.js";
import { nameOf } from "../../state/figure.js";
import { capOf } from "../../state/limits.js";
import { mirror } from "../../state/mirror.js";
import { draft } from "../../state/project.js";
import { LONGEST, poseOf, secondsOf } from "../../state/records.js";
import { isLive, mayEdit } from "../../state/robot.js";
import {
  action,
  actionBefore,
  addAction,
  nameOfAction,
  searchActions,
  searchText,
  startPose,
  toggleGhost,
} from "../../state/shown-action.js";
import { chooseAction } from "../../state/view.js";
import { seconds, t } from "../../texts/text.js";
import { addTaken, copyRight, duplicate, mirrorAction, take, timeForAll } from "./commands.js";
import { EasingDialog } from "./easing.js";
import { StageCard } from "./stage-card.js";
import { StepsCard } from "./steps-card.js";

/** @typedef {import("../../state/records.js").Action} Action */
/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function ActionsScreen(tools) {
  useVerdicts();
  useKeys({ m: mirrorAction, g: toggleGhost, "Control+d": duplicate });
  if (draft.value === null) return html`<${Reading} link=${tools.link} icon="actions" />`;
  if (draft.value.actions.length === 0) return html`<${NoActions} />`;
  return html`<h1 class="sr">${t("screen.actions")}</h1>
    <div class="acts">
      <${PoseList} />
      <div class="mid"><${StageCard} ...${tools} /><${Toolbar} /></div>
      <${StepsCard} />
    </div>`;
}

const NoActions = () => html`<div class="card empty">
  <${Icon} name="actions" />
  <h1>${t("actions.none")}</h1>
  <p>${t("actions.none_detail")}</p>
  ${
    mayEdit.value &&
    html`<div class="row wrap">
    <button class="btn pri" onClick=${addTaken}><${Icon} name="camera" />${t("actions.take_first")}</button>
    <button class="btn" onClick=${() => addAction("actions.did_add", t("actions.new_name", { number: 1 }), [])}>
      <${Icon} name="plus" />${t("actions.start_empty")}
    </button>
    <${PasteButton} isWide />
  </div>`
  }
</div>`;

// Toolbar of changes to the whole action.

function Toolbar() {
  const [isEasing, setEasing] = useState(false);
  const one = action.value,
    hasSides = mirror.value.size > 0,
    reason = hasSides ? undefined : t("actions.no_sides");
  if (one === null || !mayEdit.value) return null;
  return html`<div class="card toolbar" role="toolbar" aria-label=${t("actions.tools")}>
    <button class="btn" disabled=${!hasSides} title=${reason} onClick=${mirrorAction}>
      <${Icon} name="mirror" />${t("actions.mirror")} <kbd class="hide-t hide-n">M</kbd>
    </button>
    <button class="btn" disabled=${!hasSides} title=${reason} onClick=${copyRight}>
      <${Icon} name="copy" /><span>${t("actions.copy_right")}</span>
    </button>
    <button class="btn" disabled=${!isLive.value} onClick=${take}><${Icon} name="camera" /><span>${t("actions.take")}</span></button>
    <button class="btn" disabled=${one.steps.length === 0} onClick=${() => setEasing(true)}>${t("easing.button")}</button>
    ${isEasing && html`<${EasingDialog} onClose=${() => setEasing(false)} />`}
    <span class="grow"></span>
    <label class="row allin">
      <span class="mut">${t("actions.all_in")}</span>
      <${NumberField} value=${secondsOf(one)} format=${seconds} step=${0.01} low=${0} high=${LONGEST / 1000} label=${t("actions.time_for_all")} onChange=${timeForAll} />
    </label>
  </div>`;
}

// All actions as pictures of their poses.

function PoseList() {
  const actions = draft.value?.actions ?? [],
    list = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => {
    list.current?.querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }, [action.value?.action_id]);
  return html`<section class="card list" aria-label=${t("screen.actions")}>
    <header>
      <h2>${t("screen.actions")} <span class="mut num count">${actions.length}</span></h2>
      ${mayEdit.value && html`<button class="btn s ic" aria-label=${t("actions.new")} title=${t("actions.new")} onClick=${addTaken}><${Icon} name="plus" /></button><${PasteButton} />`}
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
    <${VerdictMark} type="action" id=${one.action_id} />
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
