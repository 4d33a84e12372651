// What to know before it is written: what the board would refuse, what is odd, and how much memory is left.

import { html } from "../../html.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../state/plan.js").Plan} Plan */
/** @typedef {import("../../state/plan.js").Found} Found */

const MOST = 8;

/** @param {{ plan: Plan, found: Found[] }} props */
export function Checks({ plan, found }) {
  const errors = found.filter(({ severity }) => severity === "error"),
    others = found.filter(({ severity }) => severity !== "error");
  const warning = plan.memory?.warning;
  return html`<section class="card">
    <header><h2>${t("project.checks")}</h2></header>
    <div class="pad0 stack">
      ${errors.length === 0 && html`<${Note} kind="ok" title=${t("project.nothing_refused")} />`}
      ${errors.length > 0 && html`<${Note} kind="bad" title=${t("project.refused", { count: errors.length })} /><${List} found=${errors} />`}
      ${others.length > 0 && html`<${Note} kind="warn" title=${t("project.odd", { count: others.length })} /><${List} found=${others} />`}
      ${plan.inconsistencies.length > 0 && html`<${Note} kind="warn" title=${t("project.repairs")} detail=${plan.inconsistencies.map(safeText).join("; ")} />`}
      ${warning && html`<${Note} kind="warn" title=${t("project.may_not_fit")} detail=${safeText(warning)} />`}
    </div>
  </section>`;
}

/** @param {{ found: Found[] }} props */
const List = ({ found }) => html`<ul class="found">
  ${found.slice(0, MOST).map(({ path, text }) => html`<li><code>${safeText(path)}</code> ${safeText(text)}</li>`)}
  ${found.length > MOST && html`<li class="mut">${t("project.more", { count: found.length - MOST })}</li>`}
</ul>`;

/** @param {{ memory: import("../../state/plan.js").Memory | null }} props */
export function MemoryCard({ memory }) {
  if (memory === null || memory.size_bytes === null || memory.size_bytes <= 0) return null;
  const size = memory.size_bytes,
    used = size - memory.free_before_bytes,
    after = size - memory.free_after_bytes;
  const share = (/** @type {number} */ bytes) => `${Math.max(0, Math.min(100, (bytes / size) * 100))}%`;
  return html`<section class="card">
    <header><h2>${t("project.memory")}</h2></header>
    <div class="pad0">
      <div class="mem"><i style=${{ width: share(Math.min(used, after)) }}></i><i style=${{ width: share(Math.max(0, after - used)) }}></i></div>
      <p class="mut num">${t("project.memory_after", { after: after.toLocaleString(), size: size.toLocaleString() })}</p>
    </div>
  </section>`;
}
