// Chosen button: name, and macros started by the button.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { edit, settle } from "../../state/project.js";
import { fitCaption } from "../../state/records.js";
import { chooseMacro } from "../../state/view.js";
import { seconds, t } from "../../texts/text.js";
import { buttonOf, SLOTS, withButton } from "../../state/edit-buttons.js";

/** @typedef {import("../../state/records.js").Project} Project */
/** @typedef {import("../../state/records.js").Table} Table */
/** @typedef {import("../../state/edit-buttons.js").Slot} Slot */
/** @typedef {import("../../texts/text.js").Key} Key */

/** @type {Record<Slot, { icon: string, title: Key, hint: Key }>} */
const TEXTS = {
  button_press_macro: { icon: "press", title: "buttons.press", hint: "buttons.press_hint" },
  button_long_press_macro: { icon: "long-press", title: "buttons.long_press", hint: "buttons.long_press_hint" },
  button_up_macro: { icon: "up", title: "buttons.up", hint: "buttons.up_hint" },
};

/** @param {{ project: Project, table: Table, id: number, lasts: Map<number, number | null> }} props */
export function Assign({ project, table, id, lasts }) {
  const button = buttonOf(table, id);
  /**
   * @param {Partial<import("../../state/records.js").Button>} values
   * @param {string} [merge]
   */
  const change = (values, merge) =>
    edit(["buttons.edit", { id }], (before) => withButton(before, table.table_id, id, values), merge);
  const clear = () =>
    change({
      button_caption: "",
      button_press_macro: 0,
      button_long_press_macro: 0,
      button_up_macro: 0,
      uninterruptible: 0,
    });
  /** @param {Event} event */
  const rename = (event) =>
    change({ button_caption: fitCaption(/** @type {HTMLInputElement} */ (event.currentTarget).value) }, `name ${id}`);
  /** @param {Event} event */
  const setWaits = (event) =>
    change({ uninterruptible: Number(/** @type {HTMLInputElement} */ (event.currentTarget).checked) });
  return html`<section class="card assign" aria-label=${t("buttons.button", { id })}>
    <header>
      <span class="sid acc large">${id}</span>
      <input class="inp" value=${safeText(button.button_caption)} placeholder=${t("buttons.name")} aria-label=${t("buttons.name")} onInput=${rename} onBlur=${settle} />
      <button class="btn ic" aria-label=${t("buttons.clear")} title=${t("buttons.clear")} onClick=${clear}><${Icon} name="close" /></button>
    </header>
    <div class="pad0 asg">
      ${SLOTS.map((slot) => html`<${SlotRow} key=${slot} ...${{ project, slot, lasts }} value=${button[slot]} onChange=${(/** @type {number} */ macroId) => change({ [slot]: macroId })} />`)}
      <label class="sw top">
        <input type="checkbox" checked=${button.uninterruptible !== 0} onChange=${setWaits} />
        <span><b>${t("buttons.finish")}</b><small>${t("buttons.finish_hint")}</small></span>
      </label>
      <${HoldNote} project=${project} press=${button.button_press_macro} long=${button.button_long_press_macro} />
    </div>
  </section>`;
}

/** @param {{ project: Project, slot: Slot, value: number, lasts: Map<number, number | null>, onChange: (macroId: number) => void }} props */
function SlotRow({ project, slot, value, lasts, onChange }) {
  const { icon, title, hint } = TEXTS[slot];
  const isMissing = value !== 0 && !project.macros.some((macro) => macro.macro_id === value);
  return html`<div class="slot">
    <span class="ico"><${Icon} name=${icon} /></span>
    <div><b>${t(title)}</b><small>${t(hint)}</small></div>
    ${
      value !== 0 && !isMissing
        ? html`<a class="btn s ic ghost" href="#macros" aria-label=${t("buttons.show_macro")} title=${t("buttons.show_macro")} onClick=${() => chooseMacro(value)}><${Icon} name="play" /></a>`
        : html`<span></span>`
    }
    <select class="inp" aria-label=${t(title)} onChange=${(/** @type {Event} */ event) => onChange(Number(/** @type {HTMLSelectElement} */ (event.currentTarget).value))}>
      <option value="0" selected=${value === 0}>${t("buttons.nothing")}</option>
      ${isMissing && html`<option value=${value} selected>${t("buttons.missing_macro", { id: value })}</option>`}
      ${project.macros.map(
        (macro) => html`<option value=${macro.macro_id} selected=${macro.macro_id === value}>
          ${macroName(project, macro.macro_id)} · ${seconds(lasts.get(macro.macro_id) ?? 0, 1)}
        </option>`,
      )}
    </select>
  </div>`;
}

/** @param {{ project: Project, press: number, long: number }} props */
function HoldNote({ project, press, long }) {
  if (press === 0 || long === 0) return null;
  const names = { press: macroName(project, press), long: macroName(project, long) };
  return html`<${Note} kind="info" title=${t("buttons.hold_begins")} detail=${t("buttons.hold_begins_detail", names)} />`;
}

/**
 * Return what a macro is called, empty for none.
 * @param {Project | null} project
 * @param {number} id
 */
export function macroName(project, id) {
  if (id === 0) return "";
  const macro = project?.macros.find((each) => each.macro_id === id);
  return safeText(macro?.macro_caption ?? "") || t("buttons.macro", { id });
}
