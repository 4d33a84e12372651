// Verdicts of the twin about the draft, before anything is written.

import { html } from "../../html.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { whenOf } from "../../parts/twin.js";
import { figure } from "../../state/figure.js";
import { draft } from "../../state/project.js";
import { nameOfAction } from "../../state/shown-action.js";
import { nameOfMacro } from "../../state/shown-macro.js";
import { hasTwin, judged, verdictOf } from "../../state/twin.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../state/twin.js").Type} Type */
/** @typedef {{ type: Type, id: number, name: string }} Named */

/** Notes with the verdicts of the twin; a person may write all the same. */
export function TwinChecks() {
  return html`<div class="twin stack"><${Notes} /></div>`;
}

function Notes() {
  if (!hasTwin.value || figure.value === null || draft.value === null) return null;
  if (judged.value?.error)
    return html`<${Note} kind="info" title=${t("twin.failed", { reason: safeText(judged.value.error) })} />`;
  const { actions, macros } = draft.value;
  const records = /** @type {Named[]} */ ([
    ...macros.map((one) => ({ type: "macro", id: one.macro_id, name: nameOfMacro(one) })),
    ...actions.map((one) => ({ type: "action", id: one.action_id, name: nameOfAction(one) })),
  ]);
  const falls = records.filter((one) => verdictOf(one.type, one.id)?.verdict === "falls"),
    doubtful = records.filter((one) => verdictOf(one.type, one.id)?.verdict === "uncertain");
  const isWhole = judged.value?.isWhole && judged.value.of === draft.value;
  return html`
    ${falls.length > 0 && html`<${Note} kind="bad" title=${t("twin.plan_falls", { count: falls.length })} detail=${t("twin.plan_detail")} /><${Falls} records=${falls} />`}
    ${doubtful.length > 0 && html`<${Note} kind="warn" title=${t("twin.plan_doubtful", { count: doubtful.length })} /><${Falls} records=${doubtful} />`}
    ${!isWhole && html`<${Note} kind="info" title=${t("twin.plan_trying")} />`}
    ${isWhole && falls.length + doubtful.length === 0 && records.length > 0 && html`<${Note} kind="ok" title=${t("twin.plan_stands")} />`}
  `;
}

/** @param {{ records: Named[] }} props */
const Falls = ({ records }) => html`<ul class="found">
  ${records.map(({ type, id, name }) => {
    const fall = verdictOf(type, id)?.fall;
    return html`<li key=${`${type} ${id}`}>${name}${fall && ` ${whenOf(type, id, fall)}`}</li>`;
  })}
</ul>`;
