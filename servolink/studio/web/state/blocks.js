// Blocks of the robot: the program on the screen Blocks, kept by the studio, and the records made of the program.

import { computed, effect, signal } from "../html.js";
import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { compile, stillMade } from "./block-compiler.js";
import { NO_BLOCKS } from "./block-form.js";
import { draft, edit } from "./project.js";
import { hasBoard, servoIds, welcome } from "./robot.js";
import { toast } from "./toasts.js";
import { Unsaved } from "./unsaved.js";

/** @typedef {import("./block-form.js").Program} Program */
/** @typedef {import("./block-form.js").Stack} Stack */
/** @typedef {import("../link/link.js").Link} Link */
/** Blocks kept by the studio. @typedef {{ blocks: Program | null, tag: string }} Kept */
/** Unconfirmed blocks: latest program, program sent before, and tag of the replaced blocks. @typedef {{ blocks: Program, sent: Program | null, known: string }} Pending */

const LASTS = 20_000; // milliseconds in which people can bring their own blocks back
const KEY = "servolink.unsaved_blocks.";

/** Program of this robot, null until the studio was asked. */
export const program = signal(/** @type {Program | null} */ (null));
/** What the program makes of the draft; null until both are known. */
export const compiled = computed(() =>
  program.value && draft.value ? compile(program.value, draft.value, servoIds.value) : null,
);
/** Records in the draft that were made of blocks. */
export const made = computed(() => (program.value && draft.value ? stillMade(program.value, draft.value) : []));

/** @type {Link | null} */
let link = null;
/** @type {Promise<void>} */
let asked = Promise.resolve();
let unsaved = /** @type {Unsaved<Pending>} */ (new Unsaved(KEY));
let tag = "";
/** Program sent to the studio and not answered; null for none. @type {Program | null} */
let sent = null;
let isSaving = false;
let isChanged = false;

/**
 * Ask the studio for the blocks, and follow changes by other pages, from the first call on.
 * @param {Link} given
 */
export function openBlocks(given) {
  if (link !== null) return asked;
  link = given;
  unsaved = new Unsaved(`${KEY}${welcome.value?.name}`);
  link.on("studio.blocks", take);
  effect(() => {
    if (welcome.value !== null && hasBoard.value) asked = given.call("studio.blocks.get").then(take, () => {}); // the connection is lost
  });
  return asked;
}

/**
 * Take over the blocks kept by the studio, unless changes here were not saved: those are tried first.
 * @param {Kept} kept
 */
function take(kept) {
  if (program.value === null) bringBack();
  if (isSaving) return;
  if (isChanged) return void save();
  if (kept.tag === tag && program.value !== null) return;
  tag = kept.tag;
  program.value = kept.blocks ?? NO_BLOCKS;
}

/** Bring back unconfirmed blocks of an earlier page. */
function bringBack() {
  const pending = unsaved.read();
  if (pending === null) return;
  ({ sent, known: tag } = pending);
  program.value = pending.blocks;
  isChanged = true;
}

/**
 * Change the stacks of the program.
 * @param {readonly Stack[]} stacks
 */
export function changeStacks(stacks) {
  change({ ...(program.value ?? NO_BLOCKS), stacks });
}

/**
 * Show another program, and keep the program in the browser until the studio confirms.
 * @param {Program} after
 */
function change(after) {
  program.value = after;
  isChanged = true;
  keep();
  save();
}

/** Keep unconfirmed blocks in the browser. */
function keep() {
  const blocks = program.value;
  unsaved.write(isChanged && blocks !== null ? { blocks, sent, known: tag } : null);
}

/** Keep the blocks in the studio, one save after the other. Blocks of a faster page win, and a message can bring the own blocks back. */
async function save() {
  const mine = program.value,
    before = sent;
  if (!isChanged || isSaving || mine === null || link === null) return;
  isSaving = true;
  sent = mine;
  keep();
  try {
    const answer = await link.call("studio.blocks.save", { blocks: mine, known: tag });
    const isOwn = before !== null && JSON.stringify(answer.blocks) === JSON.stringify(before);
    const latest = program.value ?? mine;
    tag = answer.tag;
    sent = null;
    isChanged = isOwn || (answer.saved && latest !== mine);
    if (!answer.saved && !isOwn) {
      program.value = answer.blocks ?? NO_BLOCKS;
      sayTheirs(latest);
    }
    keep();
  } catch (error) {
    isSaving = false; // saved with the next change or connection
    toast({
      name: "blocks",
      kind: "bad",
      title: t("blocks.not_kept"),
      detail: safeText(error instanceof Error ? error.message : ""),
    });
    return;
  }
  isSaving = false;
  save();
}

/**
 * Show a message that the blocks of another page were kept, with a button for the own blocks.
 * @param {Program} mine
 */
function sayTheirs(mine) {
  toast({
    name: "blocks",
    lasts: LASTS,
    kind: "bad",
    title: t("blocks.theirs"),
    detail: t("blocks.theirs_detail"),
    action: { label: t("blocks.keep_mine"), run: () => change(mine) },
  });
}

/** Put what the blocks make into the draft, as one edit. */
export function makeRecords() {
  const result = compiled.value;
  if (result === null || program.value === null || result.problems.some((each) => !each.isLeftOut)) return;
  edit(["blocks.did_make"], () => result.project);
  change({ ...program.value, made: result.made });
  toast({ name: "blocks", kind: "ok", title: t("blocks.made"), detail: t("blocks.made_detail") });
}

/**
 * Return the blocks for a project file; undefined without any.
 * @param {Link} given
 */
export async function blocksForFile(given) {
  await openBlocks(given);
  return program.value?.stacks.length ? program.value : undefined;
}

/**
 * Take the blocks of a project file, unless the robot has others: then the person is asked.
 * @param {Link} given
 * @param {Program} blocks
 */
export async function takeBlocks(given, blocks) {
  await openBlocks(given);
  const present = program.value?.stacks ?? [];
  if (JSON.stringify(present) === JSON.stringify(blocks.stacks)) return;
  if (present.length === 0) return change(blocks);
  toast({
    title: t("blocks.in_file"),
    detail: t("blocks.in_file_detail"),
    action: { label: t("blocks.take"), run: () => change(blocks) },
  });
}
