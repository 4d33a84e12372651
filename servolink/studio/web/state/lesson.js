// Film of poses taken by hand, with the times between, and the records made from a film. The rules are those
// of `servolink/project/teaching.py`.

import { commandOf } from "./edit-macro.js";
import { fitCaption, freeId, withRecord } from "./records.js";

/** @typedef {import("../figure/figure.js").Pose} Pose */
/** @typedef {import("./records.js").Project} Project */
/**
 * A pose that was taken.
 * @typedef {object} Taken
 * @property {Pose} pose all servos, for pictures and for how far it is to the next one
 * @property {number[]} ids the servos that were limp: only they become part of the action
 * @property {number} seconds from the pose before
 * @property {number} at when it was taken, seconds of any clock
 */
/** @typedef {{ pose: Pose, at: number }} Start */
/** Highest speeds of servos, degrees per second. @typedef {Record<number, number>} Caps */

/** Shortest and longest time between two poses of a film. */
export const SHORTEST = 0.1,
  LONGEST = 327.67; // seconds
const HUNDREDTHS = 100;

/**
 * Return the film with another pose, after the time since the previous pose, or the least time for the servos.
 * @param {readonly Taken[]} film
 * @param {Start} start where the servos were released
 * @param {{ pose: Pose, ids: number[], at: number }} taken
 * @param {Caps} caps
 * @returns {Taken[]}
 */
export function withPose(film, start, { pose, ids, at }, caps) {
  const rounded = Object.fromEntries(Object.entries(pose).map(([id, angle]) => [id, Math.round(angle)]));
  const since = at - Math.max(start.at, film.at(-1)?.at ?? -Infinity);
  const needed = leastSeconds(film.at(-1)?.pose ?? start.pose, { pose: rounded, ids }, caps);
  return [...film, { pose: rounded, ids: [...ids], at, seconds: kept(Math.max(since, needed)) }];
}

/**
 * Return the least time for a pose, seconds.
 * @param {Pose} before
 * @param {{ pose: Pose, ids: readonly number[] }} taken
 * @param {Caps} caps
 */
export function leastSeconds(before, { pose, ids }, caps) {
  const needed = ids.map((id) => Math.abs(pose[id] - (before[id] ?? pose[id])) / caps[id]);
  return kept(Math.max(SHORTEST, ...needed));
}

/**
 * Return the film with another time for one pose.
 * @param {readonly Taken[]} film
 * @param {number} at
 * @param {number} seconds
 * @returns {Taken[]}
 */
export const withSeconds = (film, at, seconds) => film.with(at, { ...film[at], seconds: kept(seconds) });

/**
 * Return how long all of it takes, seconds.
 * @param {readonly Taken[]} film
 */
export const totalOf = (film) => film.reduce((sum, taken) => sum + taken.seconds, 0);

/**
 * Return the pose at a time: servos turn evenly from one to the next.
 * @param {readonly Taken[]} film
 * @param {Pose} start
 * @param {number} time seconds
 * @returns {Pose}
 */
export function poseAt(film, start, time) {
  let before = start,
    left = time;
  for (const { pose, seconds } of film) {
    if (left < seconds) return between(before, pose, left / seconds);
    left -= seconds;
    before = pose;
  }
  return before;
}

/**
 * Return why no records of a name can be made, as a text of the page; empty if possible.
 * @param {Project} project
 * @param {string} name
 * @param {number} count of poses
 * @returns {"" | "teach.name_long" | "teach.name_taken"}
 */
export function whyNot(project, name, count) {
  if (fitCaption(captionOf(name, count, count)) !== captionOf(name, count, count)) return "teach.name_long";
  const actions = project.actions.map((one) => one.action_caption),
    macros = project.macros.map((one) => one.macro_caption);
  const isPart = (/** @type {string} */ caption) =>
    caption.startsWith(`${name} `) && /^\d+$/.test(caption.slice(name.length + 1));
  return [...actions, ...macros].includes(name) || actions.some(isPart) ? "teach.name_taken" : "";
}

/**
 * Return the project with an action for each pose, and with a macro of several poses.
 * @param {Project} project
 * @param {string} name
 * @param {readonly Taken[]} film
 * @returns {{ project: Project, actionId: number, macroId: number | null }}
 */
export function withLesson(project, name, film) {
  /** @type {number[]} */
  const actionIds = [];
  let after = project;
  film.forEach(({ pose, ids, seconds }, at) => {
    const action_id = freeId("actions", after),
      interval_ms = Math.round(seconds * 1000);
    const steps = ids.map((servo_id) => ({ servo_id, degree: pose[servo_id], interval_ms }));
    actionIds.push(action_id);
    after = withRecord(after, "actions", { action_id, action_caption: captionOf(name, at + 1, film.length), steps });
  });
  if (film.length < 2) return { project: after, actionId: actionIds[0], macroId: null };
  const macroId = freeId("macros", after),
    commands = actionIds.map((id) => commandOf("action", id));
  after = withRecord(after, "macros", { macro_id: macroId, macro_caption: name, commands });
  return { project: after, actionId: actionIds[0], macroId };
}

/**
 * @param {string} name
 * @param {number} number
 * @param {number} count
 */
const captionOf = (name, number, count) => (count > 1 ? `${name} ${number}` : name);

/**
 * Return a time in units of the board, rounded up; rounded first, or 0.07 would become 0.08.
 * @param {number} seconds
 */
const kept = (seconds) =>
  Math.min(LONGEST, Math.ceil(Number((Math.max(SHORTEST, seconds) * HUNDREDTHS).toFixed(6))) / HUNDREDTHS);

/**
 * @param {Pose} from
 * @param {Pose} to
 * @param {number} share 0..1
 * @returns {Pose}
 */
const between = (from, to, share) =>
  Object.fromEntries(
    Object.entries(to).map(([id, angle]) => {
      const start = from[Number(id)] ?? angle;
      return [id, start + (angle - start) * share];
    }),
  );
