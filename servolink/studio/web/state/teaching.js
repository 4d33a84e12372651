// Teaching by hand: limbs that may go limp, poses taken by hand, and the preview on the figure.

import { computed, effect, signal } from "../html.js";
import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { limbs } from "./figure.js";
import { lessonOf, poseAt, rounded, totalOf } from "./film.js";
import { answered, ask } from "./library.js";
import { capOf } from "./limits.js";
import { Limp, released } from "./limp.js";
import { draft, edit } from "./project.js";
import { actualPose, isLive, isOthers, mayMove, servoIds } from "./robot.js";
import { forWindow } from "./storage.js";
import { withMade } from "./records.js";
import { editToast, toast } from "./toasts.js";
import { chooseAction, chooseMacro } from "./view.js";

/** @typedef {import("./film.js").Taken} Taken */
/** Where the servos were released. @typedef {{ pose: Pose, at: number }} Start */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** @typedef {{ seconds: number[], least_seconds: number[], refusal: "" | "name_long" | "name_taken", actions: any[], macros: any[] }} Lesson */
/** @typedef {import("../link/link.js").Link} Link */

const KEY = "servolink.taught",
  NAME = "servolink.taught_name";
const GENTLE = 120; // degrees per second that are fast enough for what a hand has shown
/** @type {Start} */
const NOWHERE = { pose: {}, at: -Infinity };

/** The limbs that may go limp. */
export const chosenLimbs = signal(/** @type {ReadonlySet<string>} */ (new Set()));
const taken = signal(
  read(KEY, /** @type {Taken[]} */ ([])).map((taken) => ({ ...taken, at: -1 })), // of another clock: before new poses
);
/** The pose of the film that is shown beside the robot, by its index. */
export const chosenPose = signal(/** @type {number | null} */ (null));
/** Name under which the poses will be saved, kept across reloads. */
export const name = signal(read(NAME, ""));
/** Seconds from the beginning of the preview, null while nothing is played. */
export const previewTime = signal(/** @type {number | null} */ (null));

/** Ids of the servos in the chosen limbs. */
export const chosenIds = computed(() =>
  limbs.value.filter(({ limb }) => chosenLimbs.value.has(limb)).flatMap(({ ids }) => ids),
);
/** Whether servos released by the page are limp. */
export const isLimp = computed(() => released.value.size > 0);
/** Whether this page may release limbs now. */
export const mayRelease = computed(() => isLive.value && mayMove.value && !isOthers.value);
const start = signal(NOWHERE);
/** @type {Limp | null} */
let limp = null;

const caps = () => Object.fromEntries(servoIds.value.map((id) => [id, Math.min(GENTLE, capOf(id))]));
const now = () => performance.now() / 1000;

const question = () => lessonOf(name.value.trim(), taken.value, start.value.pose, caps(), draft.value);
const lesson = answered(
  "project.lesson",
  () => (taken.value.length > 0 || name.value.trim() !== "" ? question() : null),
  /** @type {Lesson} */ ({ seconds: [], least_seconds: [], refusal: "", actions: [], macros: [] }),
);

/** Film of the poses taken so far, kept across reloads. */
export const film = computed(() =>
  taken.value.map((one, at) => ({ ...one, seconds: lesson.value.seconds[at] ?? one.seconds })),
);
/** Reason why the poses cannot be saved under this name, as the key of a text; empty if there is none. */
export const problem = computed(() => {
  const { refusal } = lesson.value;
  return refusal === "" || draft.value === null || name.value.trim() === ""
    ? ""
    : /** @type {const} */ (`teach.${refusal}`);
});
/** Whether the film and its name can become records. */
export const maySave = computed(
  () => draft.value !== null && taken.value.length > 0 && name.value.trim() !== "" && problem.value === "",
);

effect(() => keep(KEY, taken.value));
effect(() => keep(NAME, name.value));

/** @param {Link} link */
function limpOf(link) {
  limp ??= new Limp(link, () => toast({ name: "held", icon: "lock", title: t("teach.held") }));
  return limp;
}

/**
 * Choose a limb, or no longer. While limbs are limp, the choice stays.
 * @param {string} limb
 */
export function toggleLimb(limb) {
  if (isLimp.value) return;
  const after = new Set(chosenLimbs.value);
  if (!after.delete(limb)) after.add(limb);
  chosenLimbs.value = after;
}

/**
 * Release the chosen limbs: they fall. Return whether they are limp.
 * @param {Link} link
 */
export async function releaseLimbs(link) {
  if (!mayRelease.value || isLimp.value || chosenIds.value.length === 0) return false;
  start.value = { pose: actualPose(), at: now() };
  chosenPose.value = null;
  try {
    await limpOf(link).release(chosenIds.value);
  } catch (error) {
    toast({ kind: "bad", title: t("teach.not_let_go"), detail: error instanceof Error ? safeText(error.message) : "" });
  }
  return isLimp.value;
}

/** Hold the limp limbs where they are. */
export async function holdAgain() {
  await limp?.hold();
}

/** Take the pose in which the limp limbs are. */
export function takePose() {
  if (!isLimp.value || !isLive.value) return;
  const at = now(),
    seconds = at - Math.max(start.value.at, taken.value.at(-1)?.at ?? -Infinity);
  taken.value = [...film.value, { pose: rounded(actualPose()), ids: [...released.value.keys()], at, seconds }];
  chosenPose.value = taken.value.length - 1;
}

/** Forget the pose that was taken last. */
export function forgetLast() {
  taken.value = film.value.slice(0, -1);
  chosenPose.value = taken.value.length > 0 ? taken.value.length - 1 : null;
}

/**
 * Show a pose of the film beside the robot; null for none.
 * @param {number | null} at
 */
export function choosePose(at) {
  chosenPose.value = at;
}

/** @param {string} text */
export function nameLesson(text) {
  name.value = text;
}

/**
 * Return the pose before one of the film.
 * @param {number} at
 */
export const poseBefore = (at) => film.value[at - 1]?.pose ?? start.value.pose;

/**
 * Return the least time for a pose of the film, seconds.
 * @param {number} at
 */
export const leastOf = (at) => lesson.value.least_seconds[at] ?? 0;

/**
 * Set the time for a pose.
 * @param {number} at
 * @param {number} seconds
 */
export function setSeconds(at, seconds) {
  taken.value = film.value.with(at, { ...film.value[at], seconds });
}

/** Hold the limbs, then add the poses to the draft. */
export async function saveLesson() {
  await holdAgain();
  const caption = name.value.trim(),
    project = draft.value;
  if (!maySave.value || isLimp.value) return;
  /** @type {Lesson} */
  const made = await ask("project.lesson", question()).catch(sayNotSaved);
  if (made === undefined || made.refusal !== "") return; // the screen shows why
  if (draft.value !== project) return saveLesson(); // edited meanwhile, so that other ids are free
  edit(["teach.did_save", { name: safeText(caption) }], (before) => withMade(before, made));
  chooseAction(made.actions[0].action_id);
  if (made.macros.length > 0) chooseMacro(made.macros[0].macro_id);
  const count = made.actions.length,
    detail = count > 1 ? t("teach.saved_macro", { count }) : t("teach.saved_action");
  editToast({ title: t("teach.saved", { name: safeText(caption) }), detail });
  taken.value = [];
  chosenPose.value = null;
  name.value = "";
}

/** @param {unknown} error */
function sayNotSaved(error) {
  toast({ kind: "bad", title: t("note.problem"), detail: error instanceof Error ? safeText(error.message) : "" });
}

/** Return the pose of the figure in the preview, null without one. */
export const previewPose = () =>
  previewTime.value === null ? null : poseAt(film.value, poseBefore(0), previewTime.value);

/** Play the film on the figure from its beginning, or end that. The robot stays still. */
export function togglePreview() {
  if (previewTime.value !== null || film.value.length === 0) return endPreview();
  const begin = performance.now();
  previewTime.value = 0;
  const tick = (/** @type {number} */ now) => {
    if (previewTime.value === null) return;
    const next = Math.max(0, now - begin) / 1000;
    previewTime.value = next < totalOf(film.value) ? next : null;
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

/** Show the robot itself again. */
export function endPreview() {
  previewTime.value = null;
}

/**
 * Return a value kept before a reload of the page.
 * @template T
 * @param {string} key
 * @param {T} fallback
 * @returns {T}
 */
function read(key, fallback) {
  try {
    return JSON.parse(forWindow.get(key) ?? "null") ?? fallback;
  } catch {
    return fallback; // damaged
  }
}

/**
 * @param {string} key
 * @param {unknown} value
 */
function keep(key, value) {
  forWindow.set(key, JSON.stringify(value));
}
