// Copying of an action or a macro, and the dialog that pastes what was copied from another robot.

import { html, useEffect, useState } from "../html.js";
import { copiedText } from "../state/clipboard.js";
import { nameOf, namedServos } from "../state/figure.js";
import { ask } from "../state/library.js";
import { mirror, sides } from "../state/mirror.js";
import { draft, edit } from "../state/project.js";
import { withMade } from "../state/records.js";
import { editToast, toast } from "../state/toasts.js";
import { t } from "../texts/text.js";
import { copyText } from "./copy-text.js";
import { Dialog } from "./dialog.js";
import { Note } from "./note.js";
import { NumberField } from "./number-field.js";
import { safeText } from "./safe-text.js";

/** @typedef {import("../state/clipboard.js").NamedServo} NamedServo */
/** Servo of this robot by servo of the other robot. @typedef {Record<string, number>} Pairs */
/**
 * Motions fitted to this robot; `left` holds the names of actions without a step.
 * @typedef {{ servos: NamedServo[], pairs: Pairs, names: string[], left: string[], actions: import("../state/records.js").Action[], macros: import("../state/records.js").Macro[] }} Motions
 */

const NONE = "none"; // value of the choice without a servo
const LEAST = 25,
  MOST = 400; // percent of the time of a motion
const MOST_TEXT = 500_000; // characters read by the library
const NO_MOTIONS = { servos: [], pairs: {}, names: [], left: [], actions: [], macros: [] };
const NOTHING = { of: null, motions: NO_MOTIONS, problem: "" };

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
  const [text, setText] = useState(""),
    [chosen, setChosen] = useState(/** @type {Pairs | null} */ (null)),
    [isMirrored, setMirrored] = useState(false),
    [percent, setPercent] = useState(100);
  const [found, setFound] = useState(/** @type {{ of: unknown, motions: Motions, problem: string }} */ (NOTHING));
  useEffect(() => void navigator.clipboard?.readText?.().then(setText, () => {}), []); // else the person pastes by hand
  const project = draft.value;
  useEffect(() => {
    if (project === null || text === "") return setFound(NOTHING);
    let isWanted = true;
    const fit = { pairs: chosen, mirror: isMirrored ? sides() : null, percent };
    ask("project.paste", { text: text.slice(0, MOST_TEXT), project, servos: namedServos(project), ...fit }).then(
      (motions) => isWanted && setFound({ of: project, motions, problem: "" }),
      (error) => isWanted && setFound({ ...found, of: null, problem: safeText(error.message) }),
    );
    return () => void (isWanted = false);
  }, [text, chosen, isMirrored, percent, project]);
  const { motions, problem } = found;
  const paste = () => {
    onClose();
    edit(["paste.did", {}], (before) => withMade(before, motions));
    editToast({ title: t("paste.done", count(motions)) });
  };
  const isForeign = found.of !== null && motions.names.length === 0;
  return html`<${Dialog} title=${t("paste.title")} onClose=${onClose}>
    <div class="stack">
      ${problem !== "" && html`<${Note} kind="warn" urgent title=${t("note.problem")} detail=${problem} />`}
      ${
        motions.names.length > 0 &&
        html`<${Matched} motions=${motions} onChange=${setChosen} />
        <div class="row wrap">
          ${mirror.value.size > 0 && html`<label class="sw"><input type="checkbox" checked=${isMirrored} onChange=${() => setMirrored(!isMirrored)} /><span>${t("paste.mirrored")}</span></label>`}
          <label class="row"><span>${t("paste.time")}</span>
            <${NumberField} label=${t("paste.time")} value=${percent} format=${(/** @type {number} */ value) => `${value} %`} step=${5} low=${LEAST} high=${MOST} onChange=${(/** @type {number} */ value) => setPercent(Math.round(value))} /></label>
        </div>
        <p class="mut">${t("paste.detail")}</p>
        <div class="row wrap actions">
          <button class="btn pri" disabled=${found.of !== project || motions.actions.length + motions.macros.length === 0} onClick=${paste}>${t("paste.add", count(motions))}</button>
          <button class="btn" onClick=${onClose}>${t("figure.cancel")}</button>
        </div>`
      }
      ${
        motions.names.length === 0 &&
        html`<label class="field"><span>${t("paste.here")}</span>
        <textarea class="inp" rows="4" spellcheck="false" value=${text} onInput=${(/** @type {Event} */ event) => setText(/** @type {HTMLTextAreaElement} */ (event.currentTarget).value)}></textarea></label>`
      }
      ${isForeign && html`<${Note} kind="warn" urgent title=${t("paste.nothing")} detail=${t("paste.nothing_detail")} />`}
    </div>
  </${Dialog}>`;
}

/** @param {Motions} motions */
const count = ({ actions, macros }) => ({ actions: actions.length, macros: macros.length });

/** @param {{ motions: Motions, onChange: (pairs: Pairs) => void }} props */
function Matched({ motions: { names, servos, pairs, left }, onChange }) {
  const ours = draft.value ? namedServos(draft.value) : [];
  const lost = servos.filter(({ id }) => !(id in pairs)).map(theirName);
  return html`<p>${names.filter(Boolean).map(safeText).join(", ")}</p>
    <table class="pairs"><caption class="sr">${t("paste.servos")}</caption>
      <thead><tr><th>${t("paste.theirs")}</th><th>${t("paste.ours")}</th></tr></thead>
      <tbody>${servos.map((servo) => html`<${Pair} key=${servo.id} servo=${servo} ours=${ours} pairs=${pairs} onChange=${onChange} />`)}</tbody>
    </table>
    ${lost.length > 0 && html`<${Note} kind="warn" title=${t("paste.lost", { count: lost.length })} detail=${lost.join(", ")} />`}
    ${left.length > 0 && html`<${Note} kind="warn" title=${t("paste.left", { count: left.length })} detail=${left.map(safeText).join(", ")} />`}`;
}

/** @param {{ servo: NamedServo, ours: NamedServo[], pairs: Pairs, onChange: (pairs: Pairs) => void }} props */
function Pair({ servo, ours, pairs, onChange }) {
  const chosen = pairs[servo.id] ?? null,
    name = theirName(servo);
  const choose = (/** @type {Event} */ event) => {
    const { value } = /** @type {HTMLSelectElement} */ (event.currentTarget);
    const { [servo.id]: _, ...others } = pairs;
    onChange(value === NONE ? others : { ...others, [servo.id]: Number(value) });
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
