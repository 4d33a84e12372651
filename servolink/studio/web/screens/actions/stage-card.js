// The figure as the editor of a pose, with the pose before, pale.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { RunHold } from "../../parts/run-hold.js";
import { FigureStage } from "../../parts/stage.js";
import { TryOnTwin } from "../../parts/twin.js";
import { ViewChoice } from "../../parts/view-choice.js";
import { withDegrees } from "../../state/edit-action.js";
import { figure, limbs, nameOf } from "../../state/figure.js";
import { within } from "../../state/limits.js";
import { draft, isWritten, settle } from "../../state/project.js";
import { poseOf, secondsOf } from "../../state/records.js";
import { actualPose } from "../../state/robot.js";
import {
  action,
  changeAction,
  chooseGhost,
  ghostAction,
  ghostChoice,
  nameOfAction,
  showsGhost,
  toggleGhost,
} from "../../state/shown-action.js";
import { canReach, dragsLimb, endReach, missed, reach, toggleLimb } from "../../state/reach.js";
import { bodyNow, hasTwin } from "../../state/twin.js";
import { chooseServo, chosen, views } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { trialOf } from "./commands.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** Action of the dragged limb: after a deletion by somebody else, the screen shows another action. */
let dragged = /** @type {number | undefined} */ (undefined);

/** @param {Tools} tools */
export function StageCard({ motion }) {
  const trial = async () => {
    const one = action.value;
    if (one === null || !(await motion.begin())) return;
    const { parts, seconds } = trialOf(one);
    motion.play(parts, seconds);
  };
  const one = action.value;
  const stored =
    one && isWritten("action", one.action_id) ? { type: "action", id: one.action_id, seconds: secondsOf(one) } : null;
  return html`<section class="stage" aria-label=${t("actions.editor")}>
    ${figure.value && html`<${FigureStage} figure=${figure.value} scene=${scene()} label=${t("actions.editor_aria")} view=${views.actions.value} onKey=${press} />`}
    <div class="tl col"><${ViewChoice} of="actions" /></div>
    <div class="tr"><${GhostChoice} /></div>
    <div class="bl col">
      ${missed.value > 0 && html`<span class="chip warn" role="status">${t("twin.missed", { mm: Math.ceil(missed.value) })}</span>`}
      ${
        hasTwin.value
          ? html`<label class="sw"><input type="checkbox" checked=${dragsLimb.value} onChange=${toggleLimb} /><span>${t("twin.limb")}</span></label>`
          : html`<span class="chip hint hide-n"><${Icon} name="hand" />${t("actions.drag")}</span>`
      }
      ${one && html`<${TryOnTwin} type="action" id=${one.action_id} />`}
    </div>
    <div class="br"><${RunHold} label=${t("actions.hold_to_try")} stored=${stored} motion=${motion} onBegin=${trial} /></div>
  </section>`;
}

function GhostChoice() {
  /** @param {Event} event */
  const choose = (event) => {
    const { value } = /** @type {HTMLSelectElement} */ (event.currentTarget);
    chooseGhost(value === "robot" || value === "before" ? value : Number(value));
  };
  const usual = ghostChoice.value === "before" && ghostAction.value ? `: ${nameOfAction(ghostAction.value)}` : "";
  return html`<div class="ghost row">
    <label class="sw"><input type="checkbox" aria-label=${t("actions.ghost")} checked=${showsGhost.value} onChange=${toggleGhost} /><span>${t("actions.ghost")}</span></label>
    <select class="inp s" aria-label=${t("actions.ghost_of")} onChange=${choose} value=${String(ghostChoice.value)}>
      <option value="before">${t("actions.ghost_before")}${usual}</option>
      <option value="robot">${t("actions.ghost_robot")}</option>
      ${draft.value?.actions.map((one) => html`<option value=${one.action_id}>${nameOfAction(one)}</option>`)}
    </select>
  </div>`;
}

/** @returns {import("../../figure/stage.js").Scene} */
function scene() {
  const pose = () => (action.value ? poseOf(action.value) : {});
  return {
    pose,
    body: bodyNow,
    ghost: () =>
      showsGhost.value ? { ...pose(), ...(ghostAction.value ? poseOf(ghostAction.value) : actualPose()) } : null,
    chosen: () => chosen.value,
    hasGizmo: true,
    onPick: chooseServo,
    onGrab: () => (dragged = action.value?.action_id),
    onDrag: (id, angle) => dragged === action.value?.action_id && turn(id, angle, "drag"),
    canReach,
    onReach: (joint, move, start) => {
      dragged ??= action.value?.action_id;
      reach({ joint, move, start }, (angles) => dragged === action.value?.action_id && pull(joint, angles));
    },
    onRelease: () => {
      dragged = undefined;
      endReach();
      settle();
    },
  };
}

/**
 * Turn a servo of the draft; nothing moves.
 * @param {number} id
 * @param {number} angle
 * @param {string} [merge]
 */
export function turn(id, angle, merge = "") {
  const degree = within(id, angle);
  if (action.value && poseOf(action.value)[id] === degree) return;
  const values = { servo: nameOf(id), degree };
  changeAction("actions.did_turn", (one) => withDegrees(one, { [id]: degree }), {
    values,
    merge: merge && `${merge} ${id}`,
  });
}

/**
 * Turn all servos that bring the end of a limb to its place; nothing moves.
 * @param {string} joint
 * @param {import("../../state/records.js").Pose} angles
 */
function pull(joint, angles) {
  const degrees = Object.fromEntries(Object.entries(angles).map(([id, angle]) => [id, within(Number(id), angle)]));
  changeAction("actions.did_pull", (one) => withDegrees(one, degrees), { merge: `pull ${joint}` });
}

/**
 * Use the keys of the figure: arrows turn the chosen servo, or choose the next servo. Return whether the key was used.
 * @param {KeyboardEvent} event
 */
function press({ key, shiftKey, ctrlKey, altKey, metaKey }) {
  if (ctrlKey || altKey || metaKey) return false;
  const ids = limbs.value.flatMap((limb) => limb.ids),
    at = ids.indexOf(chosen.value ?? -1);
  const degree = action.value && chosen.value !== null ? (poseOf(action.value)[chosen.value] ?? 0) : 0;
  const way = { ArrowLeft: -1, ArrowRight: 1 }[key],
    next = { ArrowUp: -1, ArrowDown: 1 }[key];
  if (next !== undefined) chooseServo(ids[(at + next + ids.length) % ids.length] ?? null);
  else if (chosen.value === null) return false;
  else if (way !== undefined) turn(chosen.value, degree + way * (shiftKey ? 10 : 1), "keys");
  else if (key === "0") turn(chosen.value, 0);
  else return false;
  return true;
}
