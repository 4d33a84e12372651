// Project on the board, and the draft in place of the project. A draft is never changed: each edit makes a new draft.

import { batch, computed, effect, signal } from "../html.js";
import { differencesOf, rebased } from "./differences.js";
import { Drafts } from "./drafts.js";
import { withDurations } from "./durations.js";
import { recordOf, targetOf, withEdit } from "./records.js";
import { captions, isLive, linkState, mayEdit, welcome } from "./robot.js";
import { UndoList } from "./undo.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./undo.js").Label} Label */
/** @typedef {import("./drafts.js").Kept} Kept */
/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {{ state: "unasked" | "reading" | "ready" | "failed", done: number, total: number, item: string, error: string }} Reading */

/** Project on the board, null until the board was read. */
export const stored = signal(/** @type {Project | null} */ (null));
/** Draft of the project, null until the board was read. */
export const draft = signal(/** @type {Project | null} */ (null));
/** Progress of reading the board. */
export const reading = signal(/** @type {Reading} */ ({ state: "unasked", done: 0, total: 0, item: "", error: "" }));
/** Place where the latest edit is kept. */
export const keeping = signal(/** @type {import("./drafts.js").Keeping} */ ("saved"));
/** Edit by another page that meets an edit here or deletes a record, with the earlier record; null without an edit. */
export const conflict = signal(/** @type {{ theirs: Kept, mine: any, isDeleted: boolean } | null} */ (null));

const AGAIN = 3000; // milliseconds after which reading is tried again
const SETTLES = 500; // milliseconds between notifications of edits discarded together

/** @type {Drafts | null} */
let drafts = null;
let rereading = 0;
/** Connection with which the board was read. */
const readBy = signal(/** @type {import("../link/link.js").Welcome | null} */ (null));
const steps = /** @type {UndoList<Project>} */ (new UndoList());
/** Labels of the next steps for undo and redo; empty without a step. */
export const { undoLabel, redoLabel } = steps;

/** The records in which the draft differs from the board. */
export const differences = computed(() =>
  stored.value && draft.value ? differencesOf(stored.value, draft.value) : [],
);

/** Whether the board was read on the present connection: another board may have the same name by now. */
export const isCurrent = computed(() => readBy.value !== null && readBy.value === welcome.value);

/**
 * Return whether the board holds an action, or a macro that ends, with all its parts as the draft has them.
 * @param {"action" | "macro"} type
 * @param {number} id
 * @returns {boolean}
 */
export function isWritten(type, id) {
  const kind = type === "action" ? "actions" : "macros",
    record = draft.value && recordOf(draft.value, { kind, id });
  const isEdited = differences.value.some((one) => one.kind === kind && one.id === id);
  if (!record || isEdited || !isCurrent.value) return false;
  const commands = type === "action" ? [] : /** @type {import("./records.js").Macro} */ (record).commands;
  return commands.every((each) =>
    each.type === "action" || each.type === "macro" ? isWritten(each.type, targetOf(each)) : true,
  );
}

effect(() => {
  if (stored.value)
    captions.value = Object.fromEntries(stored.value.servo_parameters.map((one) => [one.servo_id, one.servo_caption]));
});

/**
 * Read the board unless that was done. Reading takes seconds on a slow line, so only screens that need a project call
 * this.
 * @param {Link} link
 */
export function open(link) {
  if (reading.value.state === "unasked") reread(link);
}

/**
 * Read the board again with each new connection, if it was read before.
 * @param {Link} link
 */
export function keepCurrent(link) {
  let timer = 0;
  const look = () => {
    clearTimeout(timer);
    if (!isLive.value || isCurrent.value || stored.peek() === null) return;
    if (reading.peek().state !== "reading") reread(link);
    timer = setTimeout(look, AGAIN);
  };
  effect(look);
}

/**
 * Read the board again. Edits are kept; unedited records are replaced by records of the board.
 * @param {Link} link
 * @param {Label} [label] of the step for undo after a change of the board by this page
 */
export async function reread(link, label) {
  const connection = welcome.value;
  reading.value = { state: "reading", done: 0, total: 0, item: "", error: "" };
  /** @param {{ done: number, total: number, item?: string }} progress */
  const show = ({ done, total, item = "" }) => (reading.value = { ...reading.value, done, total, item });
  try {
    const { project } = await link.call("project.export", {}, show);
    if (stored.value && draft.value) {
      const before = draft.value,
        after = rebased(stored.value, before, project);
      if (label) steps.add(label, before, after, "");
      replace(after, project);
    } else await begin(link, project);
    batch(() => {
      readBy.value = connection;
      reading.value = { ...reading.value, state: "ready" };
    });
  } catch (error) {
    reading.value = { ...reading.value, state: "failed", error: error instanceof Error ? error.message : "" };
  }
}

/**
 * Take a project for the content of the board, which holds it since the latest writing: what is edited before the board
 * is read again is an edit of that project.
 * @param {Project} project
 */
export function noteWritten(project) {
  stored.value = project;
}

/**
 * Begin a draft of the project on the board, with the edits that were kept.
 * @param {Link} link
 * @param {Project} board
 */
async function begin(link, board) {
  /** @param {Kept} theirs @param {boolean} isConflict */
  const onTheirs = (theirs, isConflict) => {
    takeTheirs(theirs, isConflict);
    if (!theirs.is_discarded) return;
    clearTimeout(rereading);
    rereading = setTimeout(() => reread(link), SETTLES); // discarded, or written to the board
  };
  const tools = {
    differences: () => differences.value,
    onTheirs,
    onKept: (/** @type {typeof keeping.value} */ state) => (keeping.value = state),
  };
  const opened = new Drafts(link, welcome.value?.name ?? "", tools);
  const edits = await opened.load();
  drafts = opened;
  replace(edits.reduce(withEdit, board), board);
  let wasOpen = true;
  effect(() => {
    const isOpen = linkState.value === "open";
    if (isOpen && !wasOpen) opened.resume();
    wasOpen = isOpen;
  });
}

/**
 * Take over an edit of another page.
 * @param {Kept} theirs
 * @param {boolean} isConflict
 */
function takeTheirs(theirs, isConflict) {
  if (draft.value === null || stored.value === null) return;
  const { kind, id } = theirs,
    mine = recordOf(draft.value, theirs);
  const edited = differences.value.find((one) => one.kind === kind && one.id === id);
  if (!theirs.is_discarded) draft.value = withEdit(draft.value, theirs);
  else if (edited) draft.value = withEdit(draft.value, { kind, id, record: edited.before ?? null });
  const isDeleted = mine !== null && recordOf(draft.value, theirs) === null; // reported even without an own edit: the record may be on the screen
  if (isConflict || isDeleted) conflict.value = { theirs, mine, isDeleted };
}

/**
 * Change the draft. Return whether anything changed.
 * @param {Label} label of the undo button
 * @param {(project: Project) => Project} change
 * @param {string} [merge] the same for all parts of one drag
 */
export function edit(label, change, merge = "") {
  const before = draft.value;
  if (before === null || (welcome.value !== null && !mayEdit.value)) return false;
  const after = withDurations(before, change(before));
  if (after === before || differencesOf(before, after).length === 0) return false;
  steps.add(label, before, after, merge);
  replace(after);
  return true;
}

/** End a drag: the next edit is a step of its own. */
export const settle = () => steps.settle();

/** Undo the latest edit of any screen. Return its label, null if there was none. */
export function undo() {
  const step = steps.undo();
  if (step !== null) replace(back(step.after, step.before));
  return step?.label ?? null;
}

/** Redo the edit undone last. Return the label of the edit, null without an edit. */
export function redo() {
  const step = steps.redo();
  if (step !== null) replace(back(step.before, step.after));
  return step?.label ?? null;
}

/**
 * Return the draft with a step reversed; later edits of other pages stay.
 * @param {Project} from
 * @param {Project} to
 */
const back = (from, to) => (draft.value === null || draft.value === from ? to : rebased(from, to, draft.value));

/**
 * @param {Project} project
 * @param {Project | null} [board] what the board holds, if that is new
 */
function replace(project, board = stored.value) {
  batch(() => {
    stored.value = board;
    draft.value = project;
    keeping.value = "saving";
  });
  drafts?.saveSoon();
}
