// Easing of the movement to an action: the curve, the error, and what they cost, before anything is made.

import { html, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Note } from "../../parts/note.js";
import { NumberField } from "../../parts/number-field.js";
import { Segments } from "../../parts/segments.js";
import { bytesOf, eased, LEAST_ERROR } from "../../state/easing.js";
import { commandOf } from "../../state/edit-macro.js";
import { edit } from "../../state/project.js";
import { fitCaption, freeId, withRecord } from "../../state/records.js";
import { action, ghostAction, nameOfAction, startPose } from "../../state/shown-action.js";
import { editToast } from "../../state/toasts.js";
import { degrees, number, t } from "../../texts/text.js";

/** @typedef {import("../../state/easing.js").Curve} Curve */

const MOST_ERROR = 20; // degrees

/** @param {{ onClose: () => void }} props */
export function EasingDialog({ onClose }) {
  const [curve, setCurve] = useState(/** @type {Curve} */ ("soft")),
    [error, setError] = useState(2);
  const one = action.value;
  if (one === null) return null;
  const { parts, worst } = eased(curve, startPose(ghostAction.value), one.steps, error);
  const from = ghostAction.value ? nameOfAction(ghostAction.value) : t("actions.ghost_robot"),
    isOne = parts.length < 2;
  const values = { count: parts.length, bytes: bytesOf(parts), worst: number(worst, 1) };
  const make = () => {
    onClose();
    makeEased(one, parts);
  };
  return html`<${Dialog} title=${t("easing.title", { name: nameOfAction(one) })} onClose=${onClose}>
    <div class="stack">
      <p class="mut">${t("easing.from", { from })}</p>
      <div><${Segments} label=${t("easing.curve")} value=${curve} onChoose=${setCurve}
        choices=${[
          { value: "linear", label: t("easing.linear") },
          { value: "soft", label: t("easing.soft") },
          { value: "snap", label: t("easing.snap") },
        ]} /></div>
      <p>${t(`easing.${curve}_detail`)}</p>
      <label class="field"><span>${t("easing.error")}</span>
        <${NumberField} label=${t("easing.error")} value=${error} format=${degrees} low=${LEAST_ERROR} high=${MOST_ERROR} onChange=${(/** @type {number} */ angle) => setError(Math.round(angle))} />
      </label>
      <${Note} kind="info" title=${t(isOne ? "easing.one" : "easing.cost", values)} detail=${t("easing.worst", values)} />
      <div class="row wrap actions">
        <button class="btn pri" disabled=${isOne} onClick=${make}>${t("easing.make", values)}</button>
        <button class="btn" onClick=${onClose}>${t("figure.cancel")}</button>
      </div>
    </div>
  </${Dialog}>`;
}

/**
 * Add the actions of an eased movement to the draft, and a macro that plays them.
 * @param {import("../../state/records.js").Action} one
 * @param {import("../../state/records.js").Step[][]} parts
 */
function makeEased(one, parts) {
  const name = nameOfAction(one);
  edit(["easing.did_make", { name }], (before) => {
    let project = before;
    const commands = parts.map((steps, index) => {
      const action_id = freeId("actions", project);
      project = withRecord(project, "actions", {
        action_id,
        action_caption: fitCaption(`${name} ${index + 1}`),
        steps,
      });
      return commandOf("action", action_id);
    });
    const macro_id = freeId("macros", project);
    return withRecord(project, "macros", { macro_id, macro_caption: fitCaption(name), commands });
  });
  editToast({ title: t("easing.made", { name }), detail: t("easing.made_detail") });
}
