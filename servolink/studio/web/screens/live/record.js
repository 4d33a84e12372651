// Recording on the screen Live, and the macro of its movement within a shown tolerance.

import { html, useEffect, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Note } from "../../parts/note.js";
import { NumberField } from "../../parts/number-field.js";
import { Reading } from "../../parts/reading.js";
import { ask } from "../../state/library.js";
import { makeMacro, NO_POSES } from "../../state/made-macro.js";
import { draft, open } from "../../state/project.js";
import { fitCaption } from "../../state/records.js";
import { isLive, mayEdit } from "../../state/robot.js";
import { beginSeeing, begunAt, endSeeing, forgetSeen, seen } from "../../state/seen-movement.js";
import { degrees, number, seconds, t } from "../../texts/text.js";

/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {import("../../state/seen-movement.js").Seen} Seen */

const LEAST_ERROR = 1,
  MOST_ERROR = 20; // degrees
const LEAD = 1; // seconds to the first pose

/** @param {{ link: Link }} props */
export function RecordMacro({ link }) {
  if (!mayEdit.value) return null;
  const isRecording = begunAt.value !== null;
  const begin = () => {
    open(link);
    beginSeeing();
  };
  return html`<button class="btn s record" aria-pressed=${String(isRecording)} disabled=${!isLive.value} onClick=${isRecording ? endSeeing : begin}>
      <i aria-hidden="true"></i><span>${t(isRecording ? "seen.end" : "seen.record")}</span>
    </button>
    ${seen.value && html`<${SeenDialog} seen=${seen.value} link=${link} />`}`;
}

/** @param {{ seen: Seen, link: Link }} props */
function SeenDialog({ seen: movement, link }) {
  const [error, setError] = useState(LEAST_ERROR),
    [few, setFew] = useState(/** @type {import("../../state/made-macro.js").FewPoses | null} */ (null));
  const [typed, setTyped] = useState(/** @type {string | null} */ (null));
  const name = typed ?? t("seen.name", { number: (draft.value?.macros.length ?? 0) + 1 });
  useEffect(() => {
    let isWanted = true;
    ask("project.thin", { ...movement, error, lead: LEAD }).then(
      (answer) => isWanted && setFew(answer),
      () => isWanted && setFew(NO_POSES),
    );
    return () => void (isWanted = false);
  }, [movement, error]);
  /** @param {SubmitEvent} event */
  const make = async (event) => {
    event.preventDefault();
    if (few && (await makeMacro(fitCaption(name.trim()), few.poses, "seen.did_make"))) forgetSeen();
  };
  const isNothing = few?.poses.length === 0;
  return html`<${Dialog} title=${t("seen.title")} onClose=${forgetSeen}>
    <form class="stack" onSubmit=${make}>
      <label class="field"><span>${t("actions.name")}</span>
        <input class="inp" maxlength="32" value=${name} onInput=${(/** @type {Event} */ event) => setTyped(/** @type {HTMLInputElement} */ (event.currentTarget).value)} /></label>
      <label class="field"><span>${t("seen.error")}</span>
        <${NumberField} label=${t("seen.error")} value=${error} format=${degrees} low=${LEAST_ERROR} high=${MOST_ERROR} onChange=${(/** @type {number} */ angle) => setError(Math.round(angle))} /></label>
      ${draft.value === null && html`<${Reading} link=${link} icon="macros" />`}
      ${few && html`<${Cost} ...${few} />`}
      <div class="row wrap actions">
        <button class="btn pri" disabled=${few === null || isNothing || draft.value === null || name.trim() === ""}>${t("seen.make")}</button>
        <button type="button" class="btn" onClick=${forgetSeen}>${t("figure.cancel")}</button>
      </div>
    </form>
  </${Dialog}>`;
}

/** @param {import("../../state/made-macro.js").FewPoses} props */
function Cost({ poses, worst, size_bytes }) {
  if (poses.length === 0) return html`<${Note} kind="warn" title=${t("seen.nothing")} />`;
  const time = poses.reduce((sum, pose) => sum + pose.seconds, 0) - LEAD;
  const title = t("seen.cost", { count: poses.length, time: seconds(time, 1), bytes: size_bytes });
  return html`<${Note} kind="info" title=${title} detail=${t("seen.worst", { worst: number(worst, 1), lead: seconds(LEAD, 0) })} />`;
}
