// Copying of an action or a macro, and the dialog that pastes what was copied from another robot.

import { html, useEffect, useState } from "../html.js";
import { copiedText, motionsIn } from "../state/clipboard.js";
import { nameOf, namedServos } from "../state/figure.js";
import { mirror } from "../state/mirror.js";
import { pairsOf, pasted } from "../state/pasting.js";
import { draft, edit } from "../state/project.js";
import { editToast, toast } from "../state/toasts.js";
import { t } from "../texts/text.js";
import { copyText } from "./copy-text.js";
import { Dialog } from "./dialog.js";
import { Note } from "./note.js";
import { NumberField } from "./number-field.js";
import { safeText } from "./safe-text.js";

/** @typedef {import("../state/clipboard.js").Motions} Motions */
/** @typedef {import("../state/clipboard.js").NamedServo} NamedServo */
/** @typedef {import("../state/pasting.js").Pairs} Pairs */

const NONE = "none"; // value of the choice without a servo
const LEAST = 25,
  MOST = 400; // percent of the time of a motion

/**
 * Copy an action or a macro to the clipboard of the system, for another robot or another page.
 * @param {"action" | "macro"} type
 * @param {number} id
 */
export async function copyMotion(type, id) {
  const project = draft.value;
  if (project === null) return;
  if (await copyText(copiedText(project, type, id, namedServos(project))))
    toast({ kind: "ok", icon: "copy", title: t("board.copied"), detail: t("paste.copied_detail") });
  else toast({ kind: "bad", title: t("board.not_copied") });
}

/** @param {{ onClose: () => void }} props */
export function PasteDialog({ onClose }) {
  const [text, setText] = useState("");
  useEffect(() => void navigator.clipboard?.readText?.().then(setText, () => {}), []); // else the person pastes by hand
  const motions = motionsIn(text);
  return html`<${Dialog} title=${t("paste.title")} onClose=${onClose}>
    ${motions && html`<${Preview} key=${text} motions=${motions} onClose=${onClose} />`}
    ${
      !motions &&
      html`<div class="stack">
      <label class="field"><span>${t("paste.here")}</span>
        <textarea class="inp" rows="4" spellcheck="false" value=${text} onInput=${(/** @type {Event} */ event) => setText(/** @type {HTMLTextAreaElement} */ (event.currentTarget).value)}></textarea></label>
      ${text !== "" && html`<${Note} kind="warn" urgent title=${t("paste.nothing")} detail=${t("paste.nothing_detail")} />`}
    </div>`
    }
  </${Dialog}>`;
}

/** @param {{ motions: Motions, onClose: () => void }} props */
function Preview({ motions, onClose }) {
  const project = draft.value,
    ours = project ? namedServos(project) : [];
  const [pairs, setPairs] = useState(() => pairsOf(motions.servos, ours)),
    [isMirrored, setMirrored] = useState(false),
    [percent, setPercent] = useState(100);
  if (project === null) return null;
  const all = mirror.value;
  const fit = { pairs, mirror: isMirrored ? all : null, percent };
  const { actions, macros, left } = pasted(project, motions, fit);
  const lost = motions.servos.filter(({ id }) => (pairs.get(id) ?? null) === null).map(theirName);
  const paste = () => {
    onClose();
    edit(["paste.did", {}], (before) => pasted(before, motions, fit).project);
    editToast({ title: t("paste.done", { actions, macros }) });
  };
  return html`<div class="stack">
    <p>${named(motions)}</p>
    <table class="pairs"><caption class="sr">${t("paste.servos")}</caption>
      <thead><tr><th>${t("paste.theirs")}</th><th>${t("paste.ours")}</th></tr></thead>
      <tbody>${motions.servos.map((servo) => html`<${Pair} key=${servo.id} servo=${servo} ours=${ours} pairs=${pairs} onChange=${setPairs} />`)}</tbody>
    </table>
    ${lost.length > 0 && html`<${Note} kind="warn" title=${t("paste.lost", { count: lost.length })} detail=${lost.join(", ")} />`}
    ${left.length > 0 && html`<${Note} kind="warn" title=${t("paste.left", { count: left.length })} detail=${left.map(safeText).join(", ")} />`}
    <div class="row wrap">
      ${all.size > 0 && html`<label class="sw"><input type="checkbox" checked=${isMirrored} onChange=${() => setMirrored(!isMirrored)} /><span>${t("paste.mirrored")}</span></label>`}
      <label class="row"><span>${t("paste.time")}</span>
        <${NumberField} label=${t("paste.time")} value=${percent} format=${(/** @type {number} */ value) => `${value} %`} step=${5} low=${LEAST} high=${MOST} onChange=${(/** @type {number} */ value) => setPercent(Math.round(value))} /></label>
    </div>
    <p class="mut">${t("paste.detail")}</p>
    <div class="row wrap actions">
      <button class="btn pri" disabled=${actions + macros === 0} onClick=${paste}>${t("paste.add", { actions, macros })}</button>
      <button class="btn" onClick=${onClose}>${t("figure.cancel")}</button>
    </div>
  </div>`;
}

/** @param {{ servo: NamedServo, ours: NamedServo[], pairs: Pairs, onChange: (pairs: Pairs) => void }} props */
function Pair({ servo, ours, pairs, onChange }) {
  const chosen = pairs.get(servo.id) ?? null,
    name = theirName(servo);
  const choose = (/** @type {Event} */ event) => {
    const { value } = /** @type {HTMLSelectElement} */ (event.currentTarget);
    onChange(new Map(pairs).set(servo.id, value === NONE ? null : Number(value)));
  };
  return html`<tr class=${chosen === null ? "lost" : ""}>
    <th scope="row">${name}</th>
    <td><select class="inp s" aria-label=${name} onChange=${choose}>
      <option value=${NONE} selected=${chosen === null}>${t("paste.none")}</option>
      ${ours.map(({ id }) => html`<option key=${id} value=${id} selected=${id === chosen}>${nameOf(id)}</option>`)}
    </select></td>
  </tr>`;
}

/** @param {NamedServo} servo */
const theirName = ({ id, caption, part }) => safeText(caption || part) || t("live.servo", { id });

/** @param {Motions} motions */
const named = ({ actions, macros }) =>
  [...macros.map((one) => one.macro_caption), ...actions.map((one) => one.action_caption)]
    .filter(Boolean)
    .map(safeText)
    .join(", ");
