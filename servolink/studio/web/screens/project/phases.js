// How far the writing is, or how it ended.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { apply, outcome, progress, rollBack } from "../../state/plan.js";
import { draft } from "../../state/project.js";
import { isLive } from "../../state/robot.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {import("../../texts/text.js").Key} Key */

/** @type {{ title: Key, phases: string[] }[]} */
const STEPS = [
  { title: "project.phase_backup", phases: ["reading", "saving"] },
  { title: "project.phase_mark", phases: ["marking"] },
  { title: "project.phase_write", phases: ["clearing", "writing"] },
  { title: "project.phase_verify", phases: ["verifying"] },
  { title: "project.phase_done", phases: ["finishing"] },
];

export function Phases() {
  const now = progress.value;
  if (now === null) return null;
  const at = STEPS.findIndex(({ phases }) => phases.includes(now.phase));
  return html`<div class="pad">
    <ol class="phase">
      ${STEPS.map(({ title }, index) => html`<li class=${index < at ? "done" : index === at ? "now" : ""} aria-current=${index === at ? "step" : undefined}>${t(title)}</li>`)}
    </ol>
    <p class="mut num" role="status">${t("project.progress", { done: now.done, total: now.total, item: safeText(now.item) })} ${t("project.nothing_moves")}</p>
    <progress max=${now.total || 1} value=${now.total ? now.done : undefined} aria-label=${t(STEPS[Math.max(0, at)].title)} />
  </div>`;
}

/** @param {{ link: Link, isUnfinished: boolean }} props */
export function Outcome({ link, isUnfinished }) {
  const { state, text, of } = outcome.value;
  if (progress.value !== null) return null;
  if (state === "broken" || isUnfinished) {
    const detail = state === "broken" ? `${safeText(text)}. ${t("project.broken_detail")}` : t("project.broken_detail");
    return html`<div class="pad0"><${Note} kind="bad" urgent title=${t("project.broken")} detail=${detail}>
      <button class="btn s pri" disabled=${!isLive.value} onClick=${() => apply(link)}>${t("project.go_on")}</button>
      <button class="btn s" disabled=${!isLive.value} onClick=${() => rollBack(link, null)}><${Icon} name="rollback" />${t("project.roll_back")}</button>
    </${Note}></div>`;
  }
  if (state === "none" || (of !== null && of !== draft.value)) return null; // or edited since
  const title = t(state === "written" ? "project.written" : "project.rolled_back");
  const number = /(\d{6,})-\d{8}T/.exec(text)?.[1];
  const detail =
    number === undefined
      ? t("project.written_detail")
      : `${t("project.written_detail")} ${t("project.kept_as", { number: Number(number) })}`;
  return html`<div class="pad0"><${Note} kind="ok" title=${title} detail=${detail} /></div>`;
}
