// What is stored on the board, and the draft of what it is to become. A draft is only ever replaced by another one.

import { batch, computed, signal } from "../html.js";
import { differencesOf, rebased } from "./differences.js";
import { withDurations } from "./durations.js";
import { welcome } from "./robot.js";
import { keepSoon, read } from "./saving.js";
import { UndoList } from "./undo.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./undo.js").Label} Label */
/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {{ state: "unasked" | "reading" | "ready" | "failed", done: number, total: number, item: string, error: string }} Reading */

/** What the board holds, null until it was read. */
export const stored = signal(/** @type {Project | null} */ (null));
/** What it is to hold, null until it was read. */
export const draft = signal(/** @type {Project | null} */ (null));
/** How far the board was read. */
export const reading = signal(/** @type {Reading} */ ({ state: "unasked", done: 0, total: 0, item: "", error: "" }));
/** Whether the latest edit is kept in this browser. */
export const isKept = signal(true);

const steps = /** @type {UndoList<Project>} */ (new UndoList());
export const { undoLabel, redoLabel } = steps;

/** The records in which the draft differs from the board. */
export const differences = computed(() => (stored.value && draft.value ? differencesOf(stored.value, draft.value) : []));

/**
 * Read what the board holds, unless that was done: it takes seconds on a slow line, so it is asked for by the first
 * screen that needs it.
 * @param {Link} link
 */
export function open(link) {
  if (reading.value.state === "unasked") reread(link);
}

/**
 * Read again what the board holds. Edits are kept, records that were not edited are those of the board.
 * @param {Link} link
 */
export async function reread(link) {
  reading.value = { state: "reading", done: 0, total: 0, item: "", error: "" };
  /** @param {{ done: number, total: number, item?: string }} progress */
  const show = ({ done, total, item = "" }) => (reading.value = { ...reading.value, done, total, item });
  try {
    const { project } = await link.call("project.export", {}, show);
    take(project);
    reading.value = { ...reading.value, state: "ready" };
  } catch (error) {
    reading.value = { ...reading.value, state: "failed", error: error instanceof Error ? error.message : "" };
  }
}

/** @param {Project} board */
function take(board) {
  const kept = stored.value && draft.value ? { board: stored.value, draft: draft.value } : read(name());
  batch(() => {
    stored.value = board;
    draft.value = kept === null ? board : rebased(kept.board, kept.draft, board);
    steps.clear(); // older steps lead to drafts of another content
  });
}

/**
 * Change the draft. Return whether anything changed.
 * @param {Label} label what it does, for the undo button
 * @param {(project: Project) => Project} change
 * @param {string} [merge] the same for all parts of one drag
 */
export function edit(label, change, merge = "") {
  const before = draft.value;
  if (before === null) return false;
  const after = withDurations(before, change(before));
  if (after === before) return false;
  steps.add(label, before, after, merge);
  replace(after);
  return true;
}

/** End a drag: the next edit is a step of its own. */
export const settle = () => steps.settle();

/** Undo the latest edit, on whatever screen it was made. Return what it was. */
export function undo() {
  const step = steps.undo();
  if (step !== null) replace(step.before);
  return step?.label ?? null;
}

/** Do again what was undone last. Return what it was. */
export function redo() {
  const step = steps.redo();
  if (step !== null) replace(step.after);
  return step?.label ?? null;
}

/** @param {Project} project */
function replace(project) {
  batch(() => {
    draft.value = project;
    isKept.value = false;
  });
  const board = /** @type {Project} */ (stored.value);
  const kept = differences.value.length === 0 ? null : { board, draft: project };
  keepSoon(name(), kept, (done) => (isKept.value = done));
}

const name = () => welcome.value?.name ?? "";
