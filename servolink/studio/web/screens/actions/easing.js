// Easing of the movement to an action: the curve, the error, and what they cost, before anything is made.

import { html, useEffect, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Note } from "../../parts/note.js";
import { NumberField } from "../../parts/number-field.js";
import { Segments } from "../../parts/segments.js";
import { rounded } from "../../state/film.js";
import { ask } from "../../state/library.js";
import { makeMacro, NO_POSES } from "../../state/made-macro.js";
import { poseOf, secondsOf } from "../../state/records.js";
import { action, ghostAction, nameOfAction, startPose } from "../../state/shown-action.js";
import { degrees, number, t } from "../../texts/text.js";

/** @typedef {"linear" | "soft" | "snap"} Curve */

const LEAST_ERROR = 1, // degree: the board takes whole ones
  MOST_ERROR = 20;

/** @param {{ onClose: () => void }} props */
export function EasingDialog({ onClose }) {
  const [curve, setCurve] = useState(/** @type {Curve} */ ("soft")),
    [error, setError] = useState(2);
  const [{ poses, worst, size_bytes }, setEased] = useState(NO_POSES);
  const one = action.value,
    ghost = ghostAction.value;
  useEffect(() => {
    let isWanted = one !== null;
    if (one === null) return undefined;
    const movement = { start: rounded(startPose(ghost)), end: poseOf(one), seconds: secondsOf(one) };
    ask("project.ease", { ...movement, curve, error }).then(
      (answer) => isWanted && setEased(answer),
      () => isWanted && setEased(NO_POSES),
    );
    return () => void (isWanted = false);
  }, [one, ghost, curve, error]);
  if (one === null) return null;
  const from = ghostAction.value ? nameOfAction(ghostAction.value) : t("actions.ghost_robot"),
    isOne = poses.length < 2;
  const values = { count: poses.length, bytes: size_bytes, worst: number(worst, 1) };
  const make = () => {
    onClose();
    makeMacro(nameOfAction(one), poses, "easing.did_make");
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
