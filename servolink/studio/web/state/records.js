// The records of a project, in the form of its file. They are never changed: each function returns new ones.

/** @typedef {{ servo_id: number, degree: number, interval_ms: number }} Step */
/** @typedef {{ action_id: number, action_caption: string, steps: readonly Step[] }} Action */
/**
 * One command of a macro; the type decides which field holds the id or the delay.
 * @typedef {object} Command
 * @property {"action" | "delay" | "macro" | "other"} type
 * @property {number} [action_id]
 * @property {number} [delay_ms]
 * @property {number} [macro_id]
 * @property {number} [command_id]
 * @property {number} [type_number]
 * @property {number} ratio_percent speed; at 50 it takes twice as long
 * @property {number} loop
 * @property {number} total_interval_ms
 */
/** @typedef {{ macro_id: number, macro_caption: string, commands: readonly Command[] }} Macro */
/** @typedef {{ button_id: number, button_caption: string, button_press_macro: number, button_long_press_macro: number, button_up_macro: number, uninterruptible: number }} Button */
/** @typedef {{ table_id: number, table_caption: string, buttons: readonly Button[] }} Table */
/** @typedef {{ servo_id: number, adjusted_degree: number, servo_caption: string }} Parameter */
/**
 * @typedef {object} Project
 * @property {number} schema
 * @property {string} [values]
 * @property {number} project_id
 * @property {readonly Parameter[]} servo_parameters
 * @property {readonly Action[]} actions
 * @property {readonly Macro[]} macros
 * @property {readonly Table[]} joystick_tables
 * @property {number | null} active_joystick_table
 */
/** @typedef {"servo_parameters" | "actions" | "macros" | "joystick_tables"} Kind */
/** @typedef {import("../figure/figure.js").Pose} Pose */

/** The field that holds the id of a record, by the field of the project that holds the record. */
export const ID_OF = /** @type {const} */ ({
  servo_parameters: "servo_id",
  actions: "action_id",
  macros: "macro_id",
  joystick_tables: "table_id",
});

/** Fields of a project besides records. */
export const NUMBERS = /** @type {const} */ (["active_joystick_table", "project_id"]);
/** @typedef {typeof NUMBERS[number]} ProjectNumber */

/** Kinds of stored records in the order of the screens. */
export const KINDS = /** @type {Kind[]} */ (Object.keys(ID_OF));
/** Longest time of one step on the board. */
export const LONGEST = 327_670; // milliseconds of one step
const CAPTION_BYTES = 32;

/**
 * Return the id of a record.
 * @param {Kind} kind
 * @param {object} record
 * @returns {number}
 */
export const idOf = (kind, record) => /** @type {any} */ (record)[ID_OF[kind]];

/**
 * Return the lowest id that no record has.
 * @param {Kind} kind
 * @param {Project} project
 */
export function freeId(kind, project) {
  const taken = new Set(project[kind].map((record) => idOf(kind, record)));
  let id = 1;
  while (taken.has(id)) id++;
  return id;
}

/**
 * Return the project with a record, which replaces a record of the same id.
 * @param {Project} project
 * @param {Kind} kind
 * @param {object} record
 * @returns {Project}
 */
export function withRecord(project, kind, record) {
  const id = idOf(kind, record),
    records = /** @type {any[]} */ ([...project[kind]]);
  const at = records.findIndex((each) => idOf(kind, each) === id);
  if (at < 0) records.push(record);
  else records[at] = record;
  return { ...project, [kind]: records };
}

/**
 * Return the project with records that the library has made.
 * @param {Project} project
 * @param {{ actions: Action[], macros: Macro[] }} made
 * @returns {Project}
 */
export const withMade = (project, { actions, macros }) =>
  macros.reduce(
    (after, one) => withRecord(after, "macros", one),
    actions.reduce((after, one) => withRecord(after, "actions", one), project),
  );

/**
 * Return the project without an action, and without the commands that run it.
 * @param {Project} project
 * @param {number} id
 * @returns {Project}
 */
export const withoutAction = (project, id) => ({
  ...withoutCommands(project, (command) => command.type === "action" && command.action_id === id),
  actions: project.actions.filter((action) => action.action_id !== id),
});

/**
 * Return the project without a macro, without commands that run the macro, and with no button to start the macro.
 * @param {Project} project
 * @param {number} id
 * @returns {Project}
 */
export function withoutMacro(project, id) {
  const others = withoutCommands(project, (command) => command.type === "macro" && command.macro_id === id);
  const free = (/** @type {number} */ macroId) => (macroId === id ? 0 : macroId);
  return {
    ...others,
    macros: others.macros.filter((macro) => macro.macro_id !== id),
    joystick_tables: project.joystick_tables.map((table) => ({
      ...table,
      buttons: table.buttons.map((button) => ({
        ...button,
        button_press_macro: free(button.button_press_macro),
        button_long_press_macro: free(button.button_long_press_macro),
        button_up_macro: free(button.button_up_macro),
      })),
    })),
  };
}

/**
 * Return the macros that run a record themselves.
 * @param {Project} project
 * @param {"action" | "macro"} type
 * @param {number} id
 */
export const callersOf = (project, type, id) =>
  project.macros.filter((macro) => macro.commands.some((command) => command.type === type && targetOf(command) === id));

/**
 * Return the id of the record run by a command, also if the record is unknown.
 * @param {Command} command
 */
export const targetOf = (command) => command.action_id ?? command.macro_id ?? command.command_id ?? 0;

/**
 * Return how long an action takes, seconds.
 * @param {Action} action
 */
export const secondsOf = (action) => Math.max(0, ...action.steps.map((step) => step.interval_ms)) / 1000;

/**
 * Return the target angles of an action by servo id: the last step of each servo counts.
 * @param {Action} action
 * @returns {Pose}
 */
export const poseOf = (action) => Object.fromEntries(action.steps.map((step) => [step.servo_id, step.degree]));

/**
 * Return the beginning of a text that fits a caption on the board, in UTF-8.
 * @param {string} text
 */
export function fitCaption(text) {
  const encoder = new TextEncoder(),
    characters = [...text];
  while (encoder.encode(characters.join("")).length > CAPTION_BYTES) characters.pop();
  return characters.join("");
}

/**
 * @param {Project} project
 * @param {(command: Command) => boolean} isUnwanted
 * @returns {Project}
 */
function withoutCommands(project, isUnwanted) {
  /** @param {Macro} macro */
  const rest = (macro) =>
    macro.commands.some(isUnwanted)
      ? { ...macro, commands: macro.commands.filter((each) => !isUnwanted(each)) }
      : macro;
  return { ...project, macros: project.macros.map(rest) };
}

/**
 * Return the record of an edit as in the project; null without the record.
 * @param {Project} project
 * @param {{ kind: Kind | ProjectNumber, id: number }} edit
 */
export function recordOf(project, { kind, id }) {
  if (kind === "active_joystick_table" || kind === "project_id") return project[kind];
  return /** @type {object[]} */ ([...project[kind]]).find((each) => idOf(kind, each) === id) ?? null;
}

/**
 * Return the project with a record as an edit wants it: null for none.
 * @param {Project} project
 * @param {{ kind: Kind | ProjectNumber, id: number, record: any }} edit
 * @returns {Project}
 */
export function withEdit(project, { kind, id, record }) {
  if (kind === "active_joystick_table" || kind === "project_id") return { ...project, [kind]: record };
  const others = /** @type {object[]} */ ([...project[kind]]).filter((each) => idOf(kind, each) !== id);
  const records = record === null ? others : [...others, record].sort((a, b) => idOf(kind, a) - idOf(kind, b));
  return { ...project, [kind]: records };
}
