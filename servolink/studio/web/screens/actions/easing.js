// Easing of the movement to an action: the curve, the error, and what they cost, before anything is made.

import { html, useEffect, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Note } from "../../parts/note.js";
import { NumberField } from "../../parts/number-field.js";
import { safeText } from "../../parts/safe-text.js";
import { Segments } from "../../parts/segments.js";
import { namesOf, rounded } from "../../state/film.js";
import { ask } from "../../state/library.js";
import { draft, edit } from "../../state/project.js";
import { fitCaption, poseOf, secondsOf, withMade } from "../../state/records.js";
import { action, ghostAction, nameOfAction, startPose } from "../../state/shown-action.js";
import { editToast, toast } from "../../state/toasts.js";
import { degrees, number, t } from "../../texts/text.js";

/** @typedef {"linear" | "soft" | "snap"} Curve */
/** Answer of the library. @typedef {{ poses: { degrees: Record<string, number>, seconds: number }[], worst: number, size_bytes: number }} Eased */

const LEAST_ERROR = 1, // degree: the board takes whole ones
  MOST_ERROR = 20;
/** @type {Eased} */
const NOTHING = { poses: [], worst: 0, size_bytes: 0 };

/** @param {{ onClose: () => void }} props */
export function EasingDialog({ onClose }) {
  const [curve, setCurve] = useState(/** @type {Curve} */ ("soft")),
    [error, setError] = useState(2);
  const [{ poses, worst, size_bytes }, setEased] = useState(NOTHING);
  const one = action.value,
    ghost = ghostAction.value;
  useEffect(() => {
    let isWanted = one !== null;
    if (one === null) return undefined;
    const movement = { start: rounded(startPose(ghost)), end: poseOf(one), seconds: secondsOf(one) };
    ask("project.ease", { ...movement, curve, error }).then(
      (answer) => isWanted && setEased(answer),
      () => isWanted && setEased(NOTHING),
    );
    return () => void (isWanted = false);
  }, [one, ghost, curve, error]);
  if (one === null) return null;
  const from = ghostAction.value ? nameOfAction(ghostAction.value) : t("actions.ghost_robot"),
    isOne = poses.length < 2;
  const values = { count: poses.length, bytes: size_bytes, worst: number(worst, 1) };
  const make = () => {
    onClose();
    makeEased(nameOfAction(one), poses);
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
 * @param {string} name
 * @param {Eased["poses"]} poses
 */
async function makeEased(name, poses) {
  const project = draft.value;
  let fitting = name;
  while (fitCaption(`${fitting} ${poses.length}`) !== `${fitting} ${poses.length}`)
    fitting = [...fitting].slice(0, -1).join("");
  const question = { ...namesOf(fitting, project), poses, start: {}, caps: {}, may_repeat: true };
  try {
    const made = await ask("project.lesson", question);
    if (draft.value !== project) return makeEased(name, poses); // edited meanwhile, so that other ids are free
    edit(["easing.did_make", { name }], (before) => withMade(before, made));
    editToast({ title: t("easing.made", { name }), detail: t("easing.made_detail") });
  } catch (error) {
    const detail = error instanceof Error ? safeText(error.message) : "";
    toast({ kind: "bad", title: t("note.problem"), detail });
  }
  return undefined;
}
