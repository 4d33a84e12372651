// Set-up of servos: a servo found by its movement, its range moved by hand, its correction, and its name.

import { batch, computed, effect, signal } from "../html.js";
import { safeText } from "../parts/safe-text.js";
import { draft, edit } from "./project.js";
import { fitCaption, withRecord } from "./records.js";
import { isFresh, servoIds, servos, welcome } from "./robot.js";
import { chooseServo, chosen } from "./view.js";

/** @typedef {import("./records.js").Parameter} Parameter */
/** @typedef {import("../figure/figure.js").Pose} Pose */
/** Lowest and highest angle, degrees. @typedef {[number, number]} Range */

const FOUND = 8; // degrees that a servo has moved when it is taken for the one that is meant
/** Largest correction of an angle, degrees to each side. */
export const MOST_TRIM = 180;

/** Angles since which movements count, null unless a servo is looked for. */
const still = signal(/** @type {Pose | null} */ (null));
/** Whether the servo that is moved by hand becomes the chosen one. */
export const isFinding = computed(() => still.value !== null);
/** Range of the measured servo so far, null unless a range is measured. */
export const measured = signal(/** @type {{ id: number, range: Range } | null} */ (null));
/** Angle at which the nudging of a servo began, null unless a servo is nudged. */
export const nudged = signal(/** @type {{ id: number, from: number } | null} */ (null));

/** The servo that is set up; undefined before the servos were read. */
export const shownServo = computed(() =>
  chosen.value !== null && servoIds.value.includes(chosen.value) ? chosen.value : servoIds.value[0],
);

effect(() => {
  void shownServo.value;
  endSetup();
});

effect(() => {
  if (!isFresh.value) return;
  const now = Object.fromEntries([...servos.value].map(([id, { angle }]) => [id, angle]));
  if (still.peek() !== null) {
    const found = movedServo(/** @type {Pose} */ (still.peek()), now);
    if (found !== null)
      batch(() => {
        still.value = now;
        chooseServo(found);
      });
  }
  const one = measured.peek();
  if (one !== null && now[one.id] !== undefined) {
    const range = widened(one.range, now[one.id]);
    if (range !== one.range) measured.value = { ...one, range };
  }
});

/**
 * Return the servo that has moved most, if by enough to be meant; else null.
 * @param {Pose} before
 * @param {Pose} now
 */
export function movedServo(before, now) {
  const ways = Object.keys(now).map((key) => ({
    id: Number(key),
    way: Math.abs(now[Number(key)] - (before[Number(key)] ?? now[Number(key)])),
  }));
  const most = ways.reduce((one, other) => (other.way > one.way ? other : one), { id: 0, way: 0 });
  return most.way >= FOUND ? most.id : null;
}

/**
 * Return a range that includes an angle; the same range if it does already.
 * @param {Range} range
 * @param {number} angle
 * @returns {Range}
 */
export const widened = (range, angle) =>
  angle < range[0] ? [angle, range[1]] : angle > range[1] ? [range[0], angle] : range;

/**
 * Return the correction to store for a servo that was nudged until it stood right.
 * @param {number} old correction so far
 * @param {number} from angle before the nudges
 * @param {number} now angle after them
 */
export const corrected = (old, from, now) => Math.max(-MOST_TRIM, Math.min(MOST_TRIM, Math.round(old + now - from)));

/** Begin to look for the servo that is moved by hand, or end that. */
export function toggleFinding() {
  still.value =
    still.value === null ? Object.fromEntries([...servos.value].map(([id, { angle }]) => [id, angle])) : null;
}

/**
 * Begin to measure the range of a servo that is moved by hand.
 * @param {number} id
 */
export function measure(id) {
  const angle = servos.value.get(id)?.angle ?? 0;
  measured.value = { id, range: [angle, angle] };
}

/**
 * Remember where the nudging of a servo begins, unless it has begun.
 * @param {number} id
 */
export function beginNudging(id) {
  if (nudged.value?.id !== id) nudged.value = { id, from: servos.value.get(id)?.angle ?? 0 };
}

/** End all measuring: the screen is left, or another servo is set up. */
export function endSetup() {
  batch(() => {
    measured.value = null;
    nudged.value = null;
  });
}

/** End the search for a servo, and all measuring. */
export function leaveSetup() {
  still.value = null;
  endSetup();
}

/**
 * Return name and correction of a servo, as edited.
 * @param {number} id
 * @returns {Parameter}
 */
export const parameterOf = (id) =>
  draft.value?.servo_parameters.find((one) => one.servo_id === id) ?? {
    servo_id: id,
    adjusted_degree: 0,
    servo_caption: "",
  };

/**
 * Name a servo. Return the name that was kept.
 * @param {number} id
 * @param {string} name
 */
export function nameServo(id, name) {
  const servo_caption = fitCaption(name);
  change(id, ["servos.did_name", { id, name: safeText(servo_caption) }], { servo_caption });
  return servo_caption;
}

/**
 * Set the correction of a servo.
 * @param {number} id
 * @param {number} adjusted_degree
 */
export function trimServo(id, adjusted_degree) {
  change(id, ["servos.did_trim", { id, degree: adjusted_degree }], { adjusted_degree });
}

/**
 * @param {number} id
 * @param {import("./undo.js").Label} label
 * @param {Partial<Parameter>} changes
 */
function change(id, label, changes) {
  const before = parameterOf(id),
    after = { ...before, ...changes };
  if (JSON.stringify(before) !== JSON.stringify(after))
    edit(label, (project) => withRecord(project, "servo_parameters", after));
}

/** Angle limits in the profile of the board, by servo id. */
export const profileLimits = computed(
  () => /** @type {Record<string, Range>} */ (welcome.value?.profile?.limits?.angles ?? {}),
);

/**
 * Keep the limits of a servo in the profile of the board, null for none. Rejects with RequestError or LinkLost.
 * @param {import("../link/link.js").Link} link
 * @param {number} servo
 * @param {Range | null} range
 */
export async function keepLimits(link, servo, range) {
  const { angles } = await link.call("studio.limits.save", {
    servo,
    low: range?.[0] ?? null,
    high: range?.[1] ?? null,
  });
  const { profile } = welcome.value ?? {};
  if (welcome.value !== null)
    welcome.value = { ...welcome.value, profile: { ...profile, limits: { ...profile?.limits, angles } } };
}
