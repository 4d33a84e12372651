// Plan of the changes that writing the draft makes on the board, and the writing itself.

import { batch, signal } from "../html.js";
import { draft, noteWritten, reread } from "./project.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {import("./records.js").Project} Project */
/** @typedef {{ what: string, old: any, new: any }} Change */
/** @typedef {{ unit_bytes: number | null, size_bytes: number | null, free_before_bytes: number, free_after_bytes: number, warning: string | null }} Memory */
/** @typedef {{ changes: Change[], inconsistencies: string[], requests: number, wire_bytes: number, estimated_seconds: number, memory: Memory | null, is_unfinished: boolean }} Plan */
/** @typedef {{ path: string, text: string, severity: string }} Found */
/** @typedef {{ phase: string, done: number, total: number, item: string }} Progress */
/** @typedef {{ number: number, time: string, board: string, file: string }} Backup */

/** Nothing was written. */
export const NO_OUTCOME = Object.freeze({ state: "none", text: "", of: null });

/** Content of a board after the deletion of everything. @type {Project} */
const EMPTY = {
  schema: 1,
  project_id: 0,
  servo_parameters: [],
  actions: [],
  macros: [],
  joystick_tables: [],
  active_joystick_table: null,
};

/** Latest plan, and the planned project. */
export const plan = signal(/** @type {{ of: Project, plan: Plan, found: Found[] } | null} */ (null));
/** Reason why there is no plan, empty if that is not known. */
export const planError = signal("");
/** Whether the studio is comparing the project with the board. */
export const isPlanning = signal(false);
/** Progress of the writing, null if nothing is being written. */
export const progress = signal(/** @type {Progress | null} */ (null));
/** Result of the latest writing, and the draft after it; null until the board was read again. */
export const outcome = signal(
  /** @type {{ state: "none" | "written" | "rolled back" | "broken", text: string, of: Project | null }} */ (
    NO_OUTCOME
  ),
);
/** Backups of the board on the machine of the studio. */
export const backups = signal(/** @type {Backup[]} */ ([]));

/**
 * Compare the draft with the board, and check it; once more if it changes meanwhile.
 * @param {Link} link
 */
export async function makePlan(link) {
  const project = draft.value;
  if (project === null || isPlanning.value || progress.value !== null) return;
  isPlanning.value = true;
  planError.value = "";
  try {
    const checked = await link.call("studio.check", { project });
    const found = /** @type {Found[]} */ (checked.found);
    if (found.some(({ severity }) => severity === "error") && project.values !== "unchecked") {
      batch(() => (plan.value = { of: project, plan: nothing(), found }));
    } else {
      const made = await link.call("project.plan", { project });
      plan.value = { of: project, plan: made, found };
    }
  } catch (error) {
    planError.value = textOf(error);
  }
  isPlanning.value = false;
  if (draft.value !== project) await makePlan(link); // it changed meanwhile, when no other plan could begin
}

/**
 * Write the draft to the board. A write that was interrupted goes on from there.
 * @param {Link} link
 */
export async function apply(link) {
  const project = draft.value;
  await write(link, "project.apply", { project }, { onWritten: () => project && noteWritten(project) });
}

/**
 * Delete everything stored on the board, after a backup.
 * @param {Link} link
 */
export const clearBoard = (link) =>
  write(link, "project.apply", { project: EMPTY, replace: true }, { label: ["settings.clear"] });

/**
 * Write a backup to the board; null for the project before the latest writing.
 * @param {Link} link
 * @param {number | null} number
 */
export const rollBack = (link, number) =>
  write(link, "project.rollback", { backup: number }, { label: ["project.roll_back"] });

/** @param {Link} link */
export async function readBackups(link) {
  const found = await link.call("project.backups").catch(() => ({ backups: [] }));
  backups.value = found.backups.reverse();
}

/**
 * @param {Link} link
 * @param {string} method
 * @param {object} params
 * @param {{ onWritten?: () => void, label?: import("./undo.js").Label }} [options] label of the step for undo, if the
 *   draft follows the board
 */
async function write(link, method, params, { onWritten = () => {}, label } = {}) {
  if (progress.value !== null) return;
  progress.value = { phase: "reading", done: 0, total: 0, item: "" };
  outcome.value = NO_OUTCOME;
  try {
    const { backup } = await link.call(method, params, (/** @type {Progress} */ step) => (progress.value = step));
    onWritten();
    outcome.value = { state: method === "project.rollback" ? "rolled back" : "written", text: backup ?? "", of: null };
  } catch (error) {
    outcome.value = { state: "broken", text: textOf(error), of: null };
  }
  progress.value = null;
  plan.value = null;
  await Promise.all([reread(link, label), readBackups(link)]);
  outcome.value = { ...outcome.value, of: draft.value };
}

/** A plan for a project that no board would store. @returns {Plan} */
const nothing = () => ({
  changes: [],
  inconsistencies: [],
  requests: 0,
  wire_bytes: 0,
  estimated_seconds: 0,
  memory: null,
  is_unfinished: false,
});

/** @param {unknown} error */
const textOf = (error) => (error instanceof Error ? error.message : String(error));

/** Forget the latest plan, and how the latest writing ended: the board is read again. */
export function dropPlan() {
  outcome.value = NO_OUTCOME;
  plan.value = null;
}
