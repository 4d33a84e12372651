// Project: differences between draft and board, writing, and roll-back.

import { html, useEffect, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { useVerdicts } from "../../parts/twin.js";
import { Reading } from "../../parts/reading.js";
import { safeText } from "../../parts/safe-text.js";
import {
  apply,
  dropPlan,
  isPlanning,
  makePlan,
  outcome,
  plan,
  planError,
  progress,
  readBackups,
  rollBack,
} from "../../state/plan.js";
import { differencesOf } from "../../state/differences.js";
import { differences, draft, reread } from "../../state/project.js";
import { isLive, isOthers, welcome } from "../../state/robot.js";
import { said } from "../../texts/said.js";
import { number, t } from "../../texts/text.js";
import { Backups } from "./backups.js";
import { Difference } from "./difference.js";
import { openFile, saveFile } from "./files.js";
import { TwinChecks } from "./twin.js";

/** @typedef {import("../../state/plan.js").Found} Found */
/** @typedef {import("../../texts/text.js").Key} Key */
/** @typedef {import("../../shell/app.js").Tools} Tools */
/** @typedef {import("../../state/plan.js").Plan} Plan */
/** @typedef {import("../../link/link.js").Link} Link */

const PAUSE = 400; // milliseconds from an edit to the plan for it

/** @param {Tools} tools */
export function ProjectScreen({ link }) {
  const project = draft.value,
    isFree = progress.value === null,
    mayWrite = welcome.value?.role === "edit";
  useVerdicts();
  useEffect(() => {
    if (project === null || !isFree || !isLive.value || !mayWrite) return undefined;
    const timer = setTimeout(() => makePlan(link), PAUSE);
    return () => clearTimeout(timer);
  }, [project, isFree, isLive.value, mayWrite]);
  useEffect(() => {
    if (isLive.value) readBackups(link);
  }, [isLive.value]);
  if (project === null) return html`<${Reading} link=${link} icon="project" />`;
  const isCurrent = plan.value !== null && plan.value.of === project;
  const made = isCurrent || isLive.value ? plan.value : null; // nothing is compared while the board is gone
  return html`<div class="proj">
    <section class="card">
      <${Head} ...${{ link, mayWrite, isCurrent, made }} />
      <${Phases} />
      <${Outcome} link=${link} isUnfinished=${made?.plan.is_unfinished ?? false} />
      ${planError.value && html`<div class="pad0"><${Note} kind="bad" title=${t("project.no_plan")} detail=${safeText(planError.value)} /></div>`}
      ${!mayWrite && html`<div class="pad0"><${Note} kind="info" title=${t("project.may_not_write")} /></div>`}
      ${made && html`<${Facts} plan=${made.plan} />`}
      ${made && made.plan.changes.length > 0 && html`<ul class="diffs">${made.plan.changes.map((change) => html`<${Difference} key=${change.what} change=${change} />`)}</ul>`}
    </section>
    <div class="side">
      ${made && html`<${Checks} plan=${made.plan} found=${made.found} />`}
      <${Backups} link=${link} mayWrite=${mayWrite} />
      <${MemoryCard} memory=${made?.plan.memory ?? null} />
    </div>
  </div>`;
}

/** @param {{ link: Link, mayWrite: boolean, isCurrent: boolean, made: typeof plan.value }} props */
function Head({ link, mayWrite, isCurrent, made }) {
  const input = useRef(/** @type {HTMLInputElement | null} */ (null));
  const count = made?.plan.changes.length ?? differences.value.length,
    isBusy = progress.value !== null;
  const isRefused = made?.found.some(({ severity }) => severity === "error") ?? false;
  const mayBegin = isLive.value && !isBusy && !isOthers.value && isCurrent && count > 0 && !isRefused;
  const choose = () => {
    const field = /** @type {HTMLInputElement} */ (input.current),
      file = field.files?.[0];
    if (file) openFile(link, file);
    field.value = ""; // so that the same file can be chosen again
  };
  return html`<header class="wrap">
    <div class="grow"><h1>${title(count, isRefused)}</h1><p class="mut">${t(isPlanning.value ? "project.comparing" : made || isLive.value ? "project.kept_here" : "project.compared_later")}</p></div>
    ${
      mayWrite &&
      html`<input type="file" accept=".json,application/json" class="sr" tabindex="-1" aria-label=${t("project.open")} ref=${input} onChange=${choose} />
    <button class="btn" disabled=${isBusy} onClick=${() => input.current?.click()}>${t("project.open")}</button>`
    }
    <button class="btn" onClick=${() => saveFile(link)}><${Icon} name="save" />${t("project.save")}</button>
    <button class="btn" disabled=${isBusy || !isLive.value} onClick=${() => again(link)}><${Icon} name="rollback" />${t("project.read_again")}</button>
    ${mayWrite && !isBusy && html`<button class="btn pri" disabled=${!mayBegin} onClick=${() => apply(link)}><${Icon} name="project" />${t("project.write")}</button>`}
  </header>`;
}

/** @param {Link} link */
async function again(link) {
  dropPlan();
  await reread(link);
  makePlan(link);
}

/**
 * @param {number} count
 * @param {boolean} isRefused
 */
function title(count, isRefused) {
  if (progress.value !== null) return t("project.writing");
  if (plan.value === null && count === 0) return t("project.compare_with_board");
  if (isRefused) return t("project.cannot_be_written");
  return count === 0 ? t("project.same") : t("project.differences", { count });
}

/** @param {{ plan: Plan }} props */
function Facts({ plan: { changes, wire_bytes: bytes, estimated_seconds: time, memory } }) {
  const size = memory?.size_bytes ?? null;
  const used = size && memory ? ((size - memory.free_after_bytes) / size) * 100 : null;
  return html`<dl class="facts">
    <div><dt>${t("project.changes")}</dt><dd>${changes.length}</dd></div>
    <div><dt>${t("project.on_the_line")}</dt><dd>${number(bytes)} <small>${t("project.bytes")}</small></dd></div>
    <div><dt>${t("project.takes")}</dt><dd>${Math.max(1, Math.round(time))} <small>s</small></dd></div>
    <div><dt>${t("project.memory_then")}</dt><dd>${used === null ? "?" : number(used, 1)} <small>%</small></dd></div>
  </dl>`;
}

// Progress of the writing, or its result.

/** @type {{ title: Key, phases: string[] }[]} */
const STEPS = [
  { title: "project.phase_backup", phases: ["reading", "saving"] },
  { title: "project.phase_mark", phases: ["marking"] },
  { title: "project.phase_write", phases: ["clearing", "writing"] },
  { title: "project.phase_verify", phases: ["verifying"] },
  { title: "project.phase_done", phases: ["finishing"] },
];

function Phases() {
  const now = progress.value;
  if (now === null) return null;
  const at = STEPS.findIndex(({ phases }) => phases.includes(now.phase));
  return html`<div class="pad">
    <ol class="phase">
      ${STEPS.map(({ title }, index) => html`<li class=${index < at ? "done" : index === at ? "now" : ""} aria-current=${index === at ? "step" : undefined}>${t(title)}</li>`)}
    </ol>
    <p class="mut num" role="status">${t("project.progress", { done: now.done, total: now.total, item: safeText(said(now.item)) })} ${t("project.nothing_moves")}</p>
    <progress max=${now.total || 1} value=${now.total ? now.done : undefined} aria-label=${t(STEPS[Math.max(0, at)].title)} />
  </div>`;
}

/** @param {{ link: Link, isUnfinished: boolean }} props */
function Outcome({ link, isUnfinished }) {
  const { state, text, of } = outcome.value;
  if (progress.value !== null) return null;
  if (state === "broken" || isUnfinished) {
    const detail = state === "broken" ? `${safeText(text)}. ${t("project.broken_detail")}` : t("project.broken_detail");
    return html`<div class="pad0"><${Note} kind="bad" urgent title=${t("project.broken")} detail=${detail}>
      <button class="btn s pri" disabled=${!isLive.value} onClick=${() => apply(link)}>${t("project.go_on")}</button>
      <button class="btn s" disabled=${!isLive.value} onClick=${() => rollBack(link, null)}><${Icon} name="rollback" />${t("project.roll_back")}</button>
    </${Note}></div>`;
  }
  if (state === "none" || (of && draft.value && differencesOf(of, draft.value).length > 0)) return null; // edited since
  const backup = /(\d{6,})-\d{8}T/.exec(text)?.[1];
  const detail =
    backup === undefined
      ? t("project.written_detail")
      : `${t("project.written_detail")} ${t("project.kept_as", { number: Number(backup) })}`;
  return html`<div class="pad0"><${Note} kind="ok" title=${t(state === "written" ? "project.written" : "project.rolled_back")} detail=${detail} /></div>`;
}

// Checks before writing: records that the board would refuse, oddities, and memory left.

const MOST = 8;

/** @param {{ plan: Plan, found: Found[] }} props */
function Checks({ plan, found }) {
  const errors = found.filter(({ severity }) => severity === "error"),
    others = found.filter(({ severity }) => severity !== "error");
  const warning = plan.memory?.warning;
  return html`<section class="card">
    <header><h2>${t("project.checks")}</h2></header>
    <div class="pad0 stack">
      ${errors.length === 0 && html`<${Note} kind="ok" title=${t("project.nothing_refused")} />`}
      ${errors.length > 0 && html`<${Note} kind="bad" title=${t("project.refused", { count: errors.length })} /><${List} found=${errors} />`}
      ${others.length > 0 && html`<${Note} kind="warn" title=${t("project.odd", { count: others.length })} /><${List} found=${others} />`}
      <${TwinChecks} />
      ${plan.inconsistencies.length > 0 && html`<${Note} kind="warn" title=${t("project.repairs")} detail=${plan.inconsistencies.map(said).map(safeText).join("; ")} />`}
      ${warning && html`<${Note} kind="warn" title=${t("project.may_not_fit")} detail=${safeText(said(warning))} />`}
    </div>
  </section>`;
}

/** @param {{ found: Found[] }} props */
const List = ({ found }) => html`<ul class="found">
  ${found.slice(0, MOST).map(({ path, text }) => html`<li><code>${safeText(path)}</code> ${safeText(said(text))}</li>`)}
  ${found.length > MOST && html`<li class="mut">${t("project.more", { count: found.length - MOST })}</li>`}
</ul>`;

/** @param {{ memory: import("../../state/plan.js").Memory | null }} props */
function MemoryCard({ memory }) {
  if (memory === null || memory.size_bytes === null || memory.size_bytes <= 0) return null;
  const size = memory.size_bytes,
    used = size - memory.free_before_bytes,
    after = size - memory.free_after_bytes;
  const share = (/** @type {number} */ bytes) => `${Math.max(0, Math.min(100, (bytes / size) * 100))}%`;
  return html`<section class="card">
    <header><h2>${t("project.memory")}</h2></header>
    <div class="pad0">
      <div class="mem"><i style=${{ width: share(Math.min(used, after)) }}></i><i style=${{ width: share(Math.max(0, after - used)) }}></i></div>
      <p class="mut num">${t("project.memory_after", { after: number(after), size: number(size) })}</p>
    </div>
  </section>`;
}
