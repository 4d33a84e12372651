// Changes of buttons and their tables. Projects are never changed: each function returns a new one.

import { freeId, withRecord } from "./records.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Table} Table */
/** @typedef {import("./records.js").Button} Button */
/** @typedef {"button_press_macro" | "button_long_press_macro" | "button_up_macro"} Slot */

/** Fields of a button with the macro of each kind of press. */
export const SLOTS = /** @type {const} */ (["button_press_macro", "button_long_press_macro", "button_up_macro"]);

/**
 * Return a button of a table; without macros for a button absent from the table.
 * @param {Table | undefined} table
 * @param {number} id
 * @returns {Button}
 */
export const buttonOf = (table, id) =>
  table?.buttons.find((button) => button.button_id === id) ?? {
    button_id: id,
    button_caption: "",
    button_press_macro: 0,
    button_long_press_macro: 0,
    button_up_macro: 0,
    uninterruptible: 0,
  };

/**
 * Return whether a button does anything.
 * @param {Button} button
 */
export const isSet = (button) => SLOTS.some((slot) => button[slot] !== 0);

/**
 * Return the project with other values of a button. A button without values is left out of its table.
 * @param {Project} project
 * @param {number} tableId
 * @param {number} id
 * @param {Partial<Button>} values
 */
export function withButton(project, tableId, id, values) {
  const table = project.joystick_tables.find((each) => each.table_id === tableId);
  if (table === undefined) return project;
  const button = { ...buttonOf(table, id), ...values };
  const others = table.buttons.filter((each) => each.button_id !== id);
  const isEmpty = !isSet(button) && button.button_caption === "" && button.uninterruptible === 0;
  const buttons = isEmpty ? others : [...others, button].sort((a, b) => a.button_id - b.button_id);
  return withRecord(project, "joystick_tables", { ...table, buttons });
}

/**
 * Return the project with a new table, and the id of the table. The first table of a project is active.
 * @param {Project} project
 * @param {string} caption
 * @returns {[Project, number]}
 */
export function withNewTable(project, caption) {
  const id = freeId("joystick_tables", project);
  const after = withRecord(project, "joystick_tables", { table_id: id, table_caption: caption, buttons: [] });
  const isFirst = project.joystick_tables.length === 0;
  return [isFirst ? { ...after, active_joystick_table: id } : after, id];
}

/**
 * Return the project with another name of a table.
 * @param {Project} project
 * @param {number} id
 * @param {string} caption
 */
export function withTableName(project, id, caption) {
  const table = project.joystick_tables.find((each) => each.table_id === id);
  return table === undefined ? project : withRecord(project, "joystick_tables", { ...table, table_caption: caption });
}

/**
 * Return the project without a table. If the active table goes, the first remaining table becomes active.
 * @param {Project} project
 * @param {number} id
 * @returns {Project}
 */
export function withoutTable(project, id) {
  const tables = project.joystick_tables.filter((each) => each.table_id !== id);
  const active = project.active_joystick_table === id ? (tables[0]?.table_id ?? null) : project.active_joystick_table;
  return { ...project, joystick_tables: tables, active_joystick_table: active };
}
