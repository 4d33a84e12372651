// Blocks of the robot: the program on the screen Blocks, kept by the studio, and the records made of the program.

import { computed, effect, signal } from "../html.js";
import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { compile, stillMade } from "./block-compiler.js";
import { NO_BLOCKS } from "./block-form.js";
import { draft, edit } from "./project.js";
import { hasBoard, servoIds, welcome } from "./robot.js";
import { toast } from "./toasts.js";

/** @typedef {import("./block-form.js").Program} Program */
/** @typedef {import("./block-form.js").Stack} Stack */
/** @typedef {import("../link/link.js").Link} Link */
/** Blocks kept by the studio. @typedef {{ blocks: Program | null, tag: string }} Kept */

const PAUSE = 300; // milliseconds after a change
const LASTS = 20_000; // milliseconds in which people can bring their own blocks back

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
let tag = "";
let timer = 0;
let isSaving = false;
let isChanged = false;

/**
 * Ask the studio for the blocks, and follow changes by other pages, from the first call on.
 * @param {Link} given
 */
export function openBlocks(given) {
  if (link !== null) return asked;
  link = given;
  link.on("studio.blocks", take);
  addEventListener("pagehide", () => save());
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
  if (isChanged || isSaving) return saveSoon();
  if (kept.tag === tag && program.value !== null) return;
  tag = kept.tag;
  program.value = kept.blocks ?? NO_BLOCKS;
}

/**
 * Change the stacks of the program.
 * @param {readonly Stack[]} stacks
 */
export function changeStacks(stacks) {
  change({ ...(program.value ?? NO_BLOCKS), stacks });
}

/**
 * Show another program, and keep the program in the studio.
 * @param {Program} after
 */
function change(after) {
  program.value = after;
  isChanged = true;
  saveSoon();
}

/** Save the blocks when no change has followed for a moment. */
function saveSoon() {
  clearTimeout(timer);
  timer = setTimeout(save, PAUSE);
}

/** Keep the blocks in the studio. If another page was faster, those blocks are shown, and a message can bring these back. */
export async function save() {
  clearTimeout(timer);
  const mine = program.value;
  if (!isChanged || mine === null || link === null) return;
  if (isSaving) return saveSoon();
  isSaving = true;
  isChanged = false;
  try {
    const answer = await link.call("studio.blocks.save", { blocks: mine, known: tag });
    tag = answer.tag;
    if (!answer.saved) {
      isChanged = false;
      program.value = answer.blocks ?? NO_BLOCKS;
      sayTheirs(mine);
    }
  } catch (error) {
    isChanged = true; // saved with the next change or connection
    toast({
      name: "blocks",
      kind: "bad",
      title: t("blocks.not_kept"),
      detail: safeText(error instanceof Error ? error.message : ""),
    });
  } finally {
    isSaving = false;
  }
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
