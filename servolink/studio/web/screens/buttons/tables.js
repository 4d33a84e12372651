// The tables of buttons as tabs; the board uses the active one.

import { html, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Icon } from "../../parts/icon.js";
import { Menu } from "../../parts/menu.js";
import { safeText } from "../../parts/safe-text.js";
import { edit } from "../../state/project.js";
import { fitCaption } from "../../state/records.js";
import { mayEdit } from "../../state/robot.js";
import { t } from "../../texts/text.js";
import { withNewTable, withoutTable, withTableName } from "../../state/edit-buttons.js";

/** @typedef {import("../../state/records.js").Project} Project */
/** @typedef {import("../../state/records.js").Table} Table */

/** @param {{ project: Project, table: Table | undefined, onChoose: (id: number) => void }} props */
export function Tables({ project, table, onChoose }) {
  const [renames, setRenames] = useState(false);
  const add = () => {
    onChoose(addTable(project));
    setRenames(true);
  };
  return html`<span class="row wrap tables">
    <div class="seg s" role="group" aria-label=${t("buttons.tables")}>
      ${project.joystick_tables.map(
        (
          each,
        ) => html`<button key=${each.table_id} aria-pressed=${String(each === table)} onClick=${() => onChoose(each.table_id)}>
          ${tableName(each)} ${each.table_id === project.active_joystick_table && html`<span class="chip ok">${t("buttons.active")}</span>`}
        </button>`,
      )}
    </div>
    ${mayEdit.value && html`<button class="btn s ic" aria-label=${t("buttons.add_table")} title=${t("buttons.add_table")} onClick=${add}><${Icon} name="plus" /></button>`}
    ${table && mayEdit.value && html`<${Menu} label=${t("buttons.table_menu", { table: tableName(table) })} items=${itemsOf(project, table, () => setRenames(true))} />`}
    ${renames && table && html`<${NameDialog} table=${table} onClose=${() => setRenames(false)} />`}
  </span>`;
}

/**
 * Add a table, and return its id.
 * @param {Project} project
 */
export function addTable(project) {
  const [after, id] = withNewTable(project, "");
  edit(["buttons.add_table"], () => after);
  return id;
}

/**
 * @param {Project} project
 * @param {Table} table
 * @param {() => void} rename
 */
function itemsOf(project, table, rename) {
  const id = table.table_id;
  const activate = () =>
    edit(["buttons.use_table", { table: tableName(table) }], (before) => ({ ...before, active_joystick_table: id }));
  const remove = () =>
    edit(["buttons.delete_table", { table: tableName(table) }], (before) => withoutTable(before, id));
  return [
    ...(project.active_joystick_table === id
      ? []
      : [{ label: t("buttons.use_table", { table: tableName(table) }), run: activate }]),
    { label: t("buttons.rename_table"), run: rename },
    { label: t("buttons.delete_table", { table: tableName(table) }), run: remove, danger: true },
  ];
}

/** @param {{ table: Table, onClose: () => void }} props */
function NameDialog({ table, onClose }) {
  const [name, setName] = useState(safeText(table.table_caption));
  /** @param {SubmitEvent} event */
  const save = (event) => {
    event.preventDefault();
    edit(["buttons.rename_table"], (before) => withTableName(before, table.table_id, fitCaption(name)));
    onClose();
  };
  return html`<${Dialog} title=${t("buttons.rename_table")} onClose=${onClose}>
    <form class="row" onSubmit=${save}>
      <input class="inp" value=${name} aria-label=${t("buttons.table_name")}
        onInput=${(/** @type {Event} */ event) => setName(/** @type {HTMLInputElement} */ (event.currentTarget).value)} />
      <button class="btn pri">${t("buttons.keep_name")}</button>
    </form>
  </${Dialog}>`;
}

/** @param {Table} table */
export const tableName = (table) => safeText(table.table_caption) || t("buttons.table", { id: table.table_id });
