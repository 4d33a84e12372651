// Recording of the hub as known to the page, marks, and plotted servos.

import { computed, signal } from "../html.js";
import { RequestError } from "../link/link.js";
import { safeText } from "../parts/safe-text.js";
import { t } from "../texts/text.js";
import { LENGTH } from "./history.js";
import { actualPose, history, isLive, servoIds, welcome } from "./robot.js";
import { toast } from "./toasts.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** @typedef {import("./history.js").History} History */
/** @typedef {{ is_recording: boolean, name: string, file: string, seconds: number, size_bytes: number, messages: number, dropped: number, problem: string }} Status */
/** A moment, with the pose of the robot then. @typedef {{ number: number, time: number, pose: Pose }} Mark */

const MOST_MARKS = 200;

/** State of the recorder in the hub; null before the first report. */
export const status = signal(/** @type {Status | null} */ (null));
/** Marks set in the present recording, in order of time. */
export const marks = signal(/** @type {readonly Mark[]} */ ([]));
/** Readings that the frozen plots show; null while the plots move. */
export const frozen = signal(/** @type {History | null} */ (null));
/** The servos that are not plotted. */
const hidden = signal(/** @type {ReadonlySet<number>} */ (new Set()));

/** The servos that are plotted. */
export const plotted = computed(() => servoIds.value.filter((id) => !hidden.value.has(id)));
/** Whether this page has the right to record: into a file of the computer, so through no link. */
export const mayRun = computed(() => (welcome.value?.role ?? "watch") !== "watch" && !welcome.value?.is_link);
/** Whether this page may record now. */
export const mayRecord = computed(() => isLive.value && mayRun.value);

/**
 * Plot these servos, or do not.
 * @param {readonly number[]} ids
 * @param {boolean} isPlotted
 */
export function plotServos(ids, isPlotted) {
  const after = new Set(hidden.value);
  for (const id of ids) {
    if (isPlotted) after.delete(id);
    else after.add(id);
  }
  hidden.value = after;
}

/** Freeze the plots, or let the plots move again. */
export const freeze = () => (frozen.value = frozen.value === null ? history.copy() : null);

/** @param {Link} link */
export async function refresh(link) {
  status.value = await link.call("recorder.status").catch(() => status.value); // the connection is lost
}

/**
 * Begin to record, or end it.
 * @param {Link} link
 */
export async function startOrStop(link) {
  const isEnd = status.value?.is_recording;
  try {
    status.value = await link.call(isEnd ? "recorder.stop" : "recorder.start");
    if (isEnd) toast({ kind: "ok", title: t("record.saved"), detail: safeText(status.value?.file ?? "") });
  } catch (error) {
    say(error);
  }
}

/**
 * Mark this moment, here and in a recording under way.
 * @param {Link} link
 */
export async function mark(link) {
  const number = (marks.value.at(-1)?.number ?? 0) + 1;
  const time = history.count > 0 ? history.times[(history.count - 1) % LENGTH] : 0;
  marks.value = [...marks.value, { number, time, pose: actualPose() }].slice(-MOST_MARKS);
  if (!status.value?.is_recording || !mayRun.value) return;
  await link.call("recorder.mark", { text: t("record.mark_number", { number }) }).catch(say);
}

/** @param {unknown} error */
export const say = (error) =>
  toast({
    kind: "bad",
    title: t("record.failed"),
    detail: error instanceof RequestError ? safeText(error.message) : t("record.lost"),
  });
