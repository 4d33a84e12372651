// Film of poses taken by hand, drawn on the figure. Its times and its records come from the library (`project.lesson`).

/** @typedef {import("../figure/figure.js").Pose} Pose */
/** @typedef {import("./records.js").Project} Project */
/**
 * A pose that was taken.
 * @typedef {object} Taken
 * @property {Pose} pose all servos, for pictures
 * @property {number[]} ids the servos that were limp: only they become part of the action
 * @property {number} seconds from the pose before
 * @property {number} at when it was taken, seconds of any clock
 */
/** Highest speeds of servos, degrees per second. @typedef {Record<number, number>} Caps */

/** Longest time between two poses of a film. */
export const LONGEST = 327.67; // seconds

/**
 * Return the question for the library: the times of a film, and the records made of it under a name.
 * @param {string} name
 * @param {readonly Taken[]} film
 * @param {Pose} start
 * @param {Caps} caps
 * @param {Project | null} project that has the names that are taken
 */
export const lessonOf = (name, film, start, caps, project) => ({
  ...namesOf(name, project),
  poses: film.map(({ pose, ids, seconds }) => ({
    degrees: Object.fromEntries(ids.map((id) => [id, pose[id]])),
    seconds: Math.max(0, Math.min(LONGEST, seconds)),
  })),
  start: rounded(start),
  caps,
});

/**
 * Return a name for new records, and the names that are taken.
 * @param {string} name
 * @param {Project | null} project
 */
export const namesOf = (name, project) => ({
  name,
  actions: Object.fromEntries((project?.actions ?? []).map((one) => [one.action_id, one.action_caption])),
  macros: Object.fromEntries((project?.macros ?? []).map((one) => [one.macro_id, one.macro_caption])),
});

/**
 * Return a pose in whole degrees.
 * @param {Pose} pose
 * @returns {Pose}
 */
export const rounded = (pose) => Object.fromEntries(Object.entries(pose).map(([id, angle]) => [id, Math.round(angle)]));

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
