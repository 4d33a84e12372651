// What is stored on the board, and the draft of what it is to become. A draft is only ever replaced by another one.

import { batch, computed, effect, signal } from "../html.js";
import { differencesOf, rebased } from "./differences.js";
import { Drafts } from "./drafts.js";
import { withDurations } from "./durations.js";
import { recordOf, withEdit } from "./records.js";
import { captions, isLive, linkState, welcome } from "./robot.js";
import { UndoList } from "./undo.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./undo.js").Label} Label */
/** @typedef {import("./drafts.js").Kept} Kept */
/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {{ state: "unasked" | "reading" | "ready" | "failed", done: number, total: number, item: string, error: string }} Reading */

/** What the board holds, null until it was read. */
export const stored = signal(/** @type {Project | null} */ (null));
/** What it is to hold, null until it was read. */
export const draft = signal(/** @type {Project | null} */ (null));
/** How far the board was read. */
export const reading = signal(/** @type {Reading} */ ({ state: "unasked", done: 0, total: 0, item: "", error: "" }));
/** Who keeps the latest edit. */
export const keeping = signal(/** @type {import("./drafts.js").Keeping} */ ("saved"));
/** An edit of another page of what this page has edited too, or that deletes a record; and what there was before. */
export const conflict = signal(/** @type {{ theirs: Kept, mine: any, isDeleted: boolean } | null} */ (null));

const AGAIN = 3000; // milliseconds after which reading is tried again
const SETTLES = 500; // milliseconds after which all edits that were given up together have been told of

/** @type {Drafts | null} */
let drafts = null;
let rereading = 0;
/** With which connection the board was read. */
const readBy = signal(/** @type {import("../link/link.js").Welcome | null} */ (null));
const steps = /** @type {UndoList<Project>} */ (new UndoList());
export const { undoLabel, redoLabel } = steps;

/** The records in which the draft differs from the board. */
export const differences = computed(() =>
  stored.value && draft.value ? differencesOf(stored.value, draft.value) : [],
);

/** Whether the board was read since this connection began: another board may have the name of the last one by now. */
export const isCurrent = computed(() => readBy.value !== null && readBy.value === welcome.value);

effect(() => {
  if (stored.value)
    captions.value = Object.fromEntries(stored.value.servo_parameters.map((one) => [one.servo_id, one.servo_caption]));
});

/**
 * Read what the board holds, unless that was done: it takes seconds on a slow line, so it is asked for by the first
 * screen that needs it.
 * @param {Link} link
 */
export function open(link) {
  if (reading.value.state === "unasked") reread(link);
}

/**
 * Read again, with each new connection, what was read before.
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
 * Read again what the board holds. Edits are kept, records that were not edited are those of the board.
 * @param {Link} link
 */
export async function reread(link) {
  const connection = welcome.value;
  reading.value = { state: "reading", done: 0, total: 0, item: "", error: "" };
  /** @param {{ done: number, total: number, item?: string }} progress */
  const show = ({ done, total, item = "" }) => (reading.value = { ...reading.value, done, total, item });
  try {
    const { project } = await link.call("project.export", {}, show);
    if (stored.value && draft.value) replace(rebased(stored.value, draft.value, project), project);
    else await begin(link, project);
    batch(() => {
      readBy.value = connection;
      reading.value = { ...reading.value, state: "ready" };
    });
  } catch (error) {
    reading.value = { ...reading.value, state: "failed", error: error instanceof Error ? error.message : "" };
  }
}

/**
 * Begin to edit what the board holds, with the edits that were kept.
 * @param {Link} link
 * @param {Project} board
 */
async function begin(link, board) {
  /** @param {Kept} theirs @param {boolean} isConflict */
  const onTheirs = (theirs, isConflict) => {
    takeTheirs(theirs, isConflict);
    if (!theirs.is_discarded) return;
    clearTimeout(rereading);
    rereading = setTimeout(() => reread(link), SETTLES); // given up, or written: then the board holds something else
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
 * Take over what another page has edited.
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
  const isDeleted = mine !== null && recordOf(draft.value, theirs) === null; // told to all: somebody may look at it
  if (isConflict || isDeleted) conflict.value = { theirs, mine, isDeleted };
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
  if (step !== null) replace(back(step.after, step.before));
  return step?.label ?? null;
}

/** Do again what was undone last. Return what it was. */
export function redo() {
  const step = steps.redo();
  if (step !== null) replace(back(step.before, step.after));
  return step?.label ?? null;
}

/**
 * Return the draft with a step done backwards; what was edited since, by other pages, stays.
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
