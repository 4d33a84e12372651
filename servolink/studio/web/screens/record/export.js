// Exports of a recording: the file of the hub, a table of the plotted readings, or actions of the marked poses.

import { saveBytes } from "../../parts/save-bytes.js";
import { LENGTH, QUANTITIES } from "../../state/history.js";
import { lessonOf, rounded } from "../../state/film.js";
import { ask } from "../../state/library.js";
import { draft, edit } from "../../state/project.js";
import { withMade } from "../../state/records.js";
import { frozen, marks, plotted, say, status } from "../../state/recording.js";
import { history } from "../../state/robot.js";
import { editToast, toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {import("../../state/history.js").History} History */

const FIRST = 0.5; // seconds to the first pose
const MOST_NAMES = 99;

/**
 * Save the file of the hub, as far as it is written.
 * @param {Link} link
 */
export async function saveRecording(link) {
  const name = status.value?.name ?? "";
  if (name === "") return toast({ title: t("record.nothing_recorded") });
  const pieces = /** @type {Uint8Array<ArrayBuffer>[]} */ ([]);
  try {
    for (let offset = 0, piece; ; offset += piece.length) {
      const { data } = await link.call("studio.recording.read", { name, offset });
      piece = Uint8Array.from(atob(data), (character) => character.charCodeAt(0));
      if (piece.length === 0) break;
      pieces.push(piece);
    }
    saveBytes(name, "application/octet-stream", pieces);
  } catch (error) {
    say(error);
  }
}

/** Save what is plotted as a table. */
export const saveTable = () => saveBytes("servos.csv", "text/csv", [tableOf(frozen.value ?? history, plotted.value)]);

/**
 * Return the readings of servos as CSV, with the columns of `servolink convert --csv --channel servos`.
 * @param {History} from
 * @param {readonly number[]} ids
 */
export function tableOf(from, ids) {
  const lines = ["seconds,servo_id,angle,current_raw,temperature_raw"],
    rings = ids.map((id) => from.of(id));
  const first = Math.max(0, from.count - LENGTH),
    start = from.times[first % LENGTH];
  for (let number = first; number < from.count; number++) {
    const at = number % LENGTH;
    ids.forEach((id, one) => {
      const values = QUANTITIES.map((quantity) => rings[one][quantity][at]);
      if (!Number.isNaN(values[0])) lines.push([(from.times[at] - start).toFixed(3), id, ...values].join());
    });
  }
  return `${lines.join("\n")}\n`;
}

/** Add an action for each marked pose to the draft, and the macro that plays them. */
export async function makeActions() {
  const film = marks.value.map(({ pose, time }, at) => ({
    pose: rounded(pose),
    ids: plotted.value.filter((id) => id in pose),
    seconds: at === 0 ? FIRST : time - marks.value[at - 1].time,
    at: time,
  }));
  if (film.length === 0 || draft.value === null)
    return toast({ title: t("record.no_marks"), detail: t("record.no_marks_detail") });
  const project = draft.value;
  try {
    for (let number = 1; number <= MOST_NAMES; number++) {
      const name = number === 1 ? t("record.action") : `${t("record.action")} ${number}`;
      const made = await ask("project.lesson", lessonOf(name, film, {}, {}, project));
      if (made.refusal !== "") continue;
      if (draft.value !== project) return makeActions(); // edited meanwhile, so that other ids are free
      edit(["teach.did_save", { name }], (before) => withMade(before, made));
      editToast({ title: t("teach.saved", { name }), detail: t("record.actions_made", { count: film.length }) });
      return undefined;
    }
  } catch (error) {
    say(error);
  }
  return undefined;
}
