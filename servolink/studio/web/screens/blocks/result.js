// What the blocks make, and the blocks that the board cannot run, each with the reason.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { compiled } from "../../state/blocks.js";
import { draft } from "../../state/project.js";
import { t } from "../../texts/text.js";

/** @typedef {import("./workspace.js").Workspace} Workspace */
/** @typedef {import("../../state/block-compiler.js").Problem} Problem */

const KINDS = /** @type {const} */ (["actions", "macros", "buttons"]);

/** Names of refused blocks, by id. @typedef {ReadonlyMap<string, string>} Names */

/**
 * Card with the number of records, the button that makes the records, and the refused blocks.
 * @param {{ space: Workspace | null, names: Names, onMake: (() => void) | null }} props
 */
export function Result({ space, names, onMake }) {
  if (compiled.value === null) return null;
  const { project, made, problems } = compiled.value;
  const refused = problems.filter((problem) => !problem.isLeftOut),
    left = problems.filter((problem) => problem.isLeftOut);
  const isDone = project === draft.value;
  return html`<section class="card side" aria-labelledby="blocks-makes">
    <header><h2 id="blocks-makes">${t("blocks.makes")}</h2></header>
    <div class="pad col">
      ${
        made.length === 0
          ? html`<p class="mut">${t("blocks.makes_nothing")}</p>`
          : html`<div class="row wrap">${KINDS.map((kind) => html`<${Count} key=${kind} kind=${kind} count=${made.filter((one) => one.kind === kind).length} />`)}</div>`
      }
      ${onMake && html`<button class="btn pri" disabled=${isDone || refused.length > 0} onClick=${onMake}><${Icon} name="arrow" />${t("blocks.make")}</button>`}
      ${made.length > 0 && isDone && refused.length === 0 && html`<p class="mut" role="status">${t("blocks.up_to_date")}</p>`}
      ${refused.length > 0 && html`<${Problems} space=${space} names=${names} title=${t("blocks.refused", { count: refused.length })} problems=${refused} />`}
      ${left.length > 0 && html`<${Problems} space=${space} names=${names} title=${t("blocks.left_out")} problems=${left} />`}
    </div>
  </section>`;
}

/** @param {{ kind: typeof KINDS[number], count: number }} props */
const Count = ({ kind, count }) => count > 0 && html`<span class="chip">${t(`blocks.${kind}`, { count })}</span>`;

/**
 * List of refused blocks; a click on an entry leads to the block.
 * @param {{ space: Workspace | null, names: Names, title: string, problems: Problem[] }} props
 */
const Problems = ({ space, names, title, problems }) => html`<div class="problems">
  <h3><${Icon} name="warn" />${title}</h3>
  <ul>
    ${problems.map(
      ({ block, reason, values }) => html`<li key=${`${block} ${reason}`}>
        <button onClick=${() => space?.choose(block)}><b>${names.get(block)}</b><span>${t(reason, values)}</span></button>
      </li>`,
    )}
  </ul>
</div>`;
