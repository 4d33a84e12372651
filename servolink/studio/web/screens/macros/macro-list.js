// All macros.

import { html, useEffect, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { draft } from "../../state/project.js";
import { seconds, t } from "../../texts/text.js";
import { addEmptyMacro, macro, nameOfMacro, secondsOfMacro, showMacro } from "../../state/shown-macro.js";

/** @typedef {import("../../state/records.js").Macro} Macro */

export function MacroList() {
  const macros = draft.value?.macros ?? [],
    list = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => {
    list.current?.querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }, [macro.value?.macro_id]);
  return html`<section class="card list" aria-label=${t("screen.macros")}>
    <header>
      <h2>${t("screen.macros")} <span class="mut num count">${macros.length}</span></h2>
      <button class="btn s ic" aria-label=${t("macros.new")} title=${t("macros.new")} onClick=${addEmptyMacro}><${Icon} name="plus" /></button>
    </header>
    <div class="mlist" ref=${list}>${macros.map(row)}</div>
  </section>`;
}

/** @param {Macro} one */
function row(one) {
  const takes = secondsOfMacro(one),
    time = takes === null ? t("macros.endless") : seconds(takes, 1);
  return html`<button key=${one.macro_id} class="mrow" aria-pressed=${String(one === macro.value)} onClick=${() => showMacro(one.macro_id)}>
    <span class="sid">${one.macro_id}</span>
    <span class="grow"><b class="ell">${nameOfMacro(one)}</b><small class="num">${t("macros.facts", { time, count: one.commands.length })}</small></span>
  </button>`;
}
