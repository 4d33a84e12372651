// Mirror images of steps. The library says which servo is the image of which, and with which angle (`project.images`).

import { computed } from "../html.js";
import { figure } from "./figure.js";
import { answered } from "./library.js";
import { captions } from "./robot.js";

/** @typedef {import("./records.js").Step} Step */
/** Image of a servo, with `factor` times the angle plus `offset`. @typedef {{ servo: number, factor: number, offset: number, is_right: boolean }} Image */
/** @typedef {Map<number, Image>} Mirror */

/** Return the names for left and right of the robot. */
export const sides = () => ({ captions: captions.value, figure: figure.value?.data ?? null });

const found = answered("project.images", sides, {
  images: /** @type {Record<string, Image>} */ ({}),
});

/** Mirror images of the servos of the robot, by id. */
export const mirror = computed(
  () => new Map(Object.entries(found.value.images).map(([id, image]) => [Number(id), image])),
);

/**
 * Return the mirror images of steps; a step of a servo without an image stays.
 * @param {readonly Step[]} steps
 * @param {Mirror} images
 * @returns {Step[]}
 */
export const mirrored = (steps, images) =>
  steps.map((step) => {
    const image = images.get(step.servo_id);
    if (image === undefined) return step;
    return { ...step, servo_id: image.servo, degree: Math.round(image.factor * step.degree + image.offset) || 0 };
  });

/**
 * Return steps whose left half is the image of their right half.
 * @param {readonly Step[]} steps
 * @param {Mirror} images
 * @returns {Step[]}
 */
export function rightToLeft(steps, images) {
  const lefts = new Set([...images.values()].filter((image) => image.is_right).map((image) => image.servo));
  const kept = steps.filter((step) => !lefts.has(step.servo_id));
  const rights = kept.filter((step) => images.get(step.servo_id)?.is_right);
  return [...kept, ...mirrored(rights, images)].sort((a, b) => a.servo_id - b.servo_id);
}
