// Twin of the robot: runs with physics, shown on the figure, and verdicts about actions and macros. No board is touched.

import { effect, signal } from "../html.js";
import { figure } from "./figure.js";
import { draft } from "./project.js";
import { recordOf, targetOf } from "./records.js";
import { linkState, welcome } from "./robot.js";

/** @typedef {import("../figure/figure.js").Figure} Figure */
/** @typedef {import("../figure/figure.js").Body} Body */
/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {import("./records.js").Macro} Macro */
/** @typedef {import("./records.js").Project} Project */
/** @typedef {"action" | "macro"} Type */
/** Moment of a fall, with the number of the command of a macro. @typedef {{ seconds: number, command: number | null }} Fall */
/** @typedef {{ verdict: "stands" | "falls" | "uncertain", fall: Fall | null }} Verdict */
/** @typedef {Verdict & { type: Type, id: number }} RecordVerdict */
/** @typedef {{ type: Type, id: number, state: "running" | "over" | "failed", seconds: number, fall: Fall | null, error: string }} Trial */
/** @typedef {{ of: Project, figure: Figure, byRecord: Map<string, Verdict>, isWhole: boolean, error: string }} Judged */
/** @typedef {[[number, number, number], [number, number, number, number], number[]]} Frame */

const HZ = 50;
const SHOWN_EVERY = 5; // frames between two changes of the time on the screen

/** Whether the computer of the studio has physics for a twin; null until that is known. */
export const hasTwin = signal(/** @type {boolean | null} */ (null));
/** Run on the twin that the figure shows; null without a run. */
export const trial = signal(/** @type {Trial | null} */ (null));
/** Latest verdicts about the records of a draft; null before the first. */
export const judged = signal(/** @type {Judged | null} */ (null));

/** @type {Link | null} */
let link = null;
/** Marks of the latest run and of the latest judging: answers to earlier ones are late. */
let run = {},
  asked = {};
/** @type {Body | null} */
let body = null;
/** @type {Project | null} */
let tried = null;

/**
 * Ask for physics over a connection, from now on.
 * @param {Link} connected
 */
export function followTwin(connected) {
  link = connected;
  effect(() => {
    if (welcome.value === null) return;
    connected.call("studio.about").then(
      (about) => (hasTwin.value = about.has_twin),
      () => {},
    ); // the connection is lost
  });
  effect(() => {
    if (linkState.value !== "open" || draft.value !== tried) endTrial();
  });
}

/** Body of the figure in the present run. */
export const bodyNow = () => body;

/**
 * Run an action or a macro on the twin.
 * @param {Type} type
 * @param {number} id
 */
export async function tryOnTwin(type, id) {
  const project = draft.value,
    robot = figure.value;
  if (link === null || project === null || robot === null) return;
  const mine = (run = {});
  tried = project;
  /** @param {Partial<Trial>} change */
  const show = (change) => {
    if (run === mine) trial.value = { ...NEW, ...trial.value, type, id, ...change };
  };
  show(NEW);
  let count = 0;
  /** @param {{ frame: Frame }} progress */
  const onProgress = ({ frame }) => {
    if (run !== mine) return;
    body = bodyOf(robot, frame);
    if (++count % SHOWN_EVERY === 0) show({ seconds: count / HZ });
  };
  try {
    const { fall } = await link.call("studio.twin.try", { project, figure: robot.data, type, id }, onProgress);
    show({ state: "over", fall });
  } catch (error) {
    show({ state: "failed", error: error instanceof Error ? error.message : "" });
  }
}

/** @type {Omit<Trial, "type" | "id">} */
const NEW = { state: "running", seconds: 0, fall: null, error: "" };

/** End the run on the twin, and show the pose again. */
export function endTrial() {
  if (trial.peek()?.state === "running") link?.tell("studio.twin.stop");
  run = {};
  body = null;
  trial.value = null;
}

/**
 * Return the body of a figure in a frame of a run.
 * @param {Figure} robot
 * @param {Frame} frame
 * @returns {Body}
 */
export function bodyOf(robot, [move, turn, angles]) {
  return { pose: Object.fromEntries(robot.servoIds.map((id, index) => [id, angles[index] ?? 0])), move, turn };
}

/** Have all actions and macros of the draft judged, in the background of the studio. */
export async function judge() {
  const of = draft.value,
    robot = figure.value,
    before = judged.peek();
  if (link === null || of === null || robot === null || hasTwin.value !== true) return;
  if (before?.of === of && before.figure === robot && before.isWhole) return;
  const mine = (asked = {});
  /** @type {Judged["byRecord"]} */
  const byRecord = new Map();
  /** @param {RecordVerdict[]} verdicts @param {Partial<Judged>} [change] */
  const take = (verdicts, change = {}) => {
    if (asked !== mine) return;
    for (const one of verdicts) byRecord.set(`${one.type} ${one.id}`, one);
    judged.value = { of, figure: robot, byRecord, isWhole: false, error: "", ...change };
  };
  try {
    const answer = await link.call("studio.twin.verdicts", { project: of, figure: robot.data }, (progress) =>
      take(progress.verdicts),
    );
    take(answer.verdicts, { isWhole: true });
  } catch (error) {
    take([], { error: error instanceof Error ? error.message : "" });
  }
}

/**
 * Return the verdict about a record as it is now, null without one.
 * @param {Type} type
 * @param {number} id
 */
export function verdictOf(type, id) {
  const found = judged.value,
    verdict = found?.byRecord.get(`${type} ${id}`);
  if (!found || !verdict || found.figure !== figure.value || draft.value === null) return null;
  return isSameRun(found.of, draft.value, type, id) ? verdict : null;
}

/**
 * Return whether a record, and each record run by it, is the same in two drafts. The record ends in the first one.
 * @param {Project} one
 * @param {Project} other
 * @param {Type} type
 * @param {number} id
 * @param {Set<string>} [seen] records that were compared: of nested macros there are many ways to each
 * @returns {boolean}
 */
export function isSameRun(one, other, type, id, seen = new Set()) {
  const key = `${type} ${id}`;
  if (one === other || seen.has(key)) return true;
  seen.add(key);
  const kind = type === "action" ? "actions" : "macros",
    record = recordOf(one, { kind, id });
  if (record !== recordOf(other, { kind, id })) return false;
  const commands = type === "action" ? [] : (/** @type {Macro | null} */ (record)?.commands ?? []);
  return commands.every((each) =>
    each.type === "action" || each.type === "macro" ? isSameRun(one, other, each.type, targetOf(each), seen) : true,
  );
}
