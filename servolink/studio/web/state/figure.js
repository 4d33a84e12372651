// Figure of the robot, and names of servos and limbs.

import { computed, effect, signal } from "../html.js";
import { Figure } from "../figure/figure.js";
import { safeText } from "../parts/safe-text.js";
import { inLanguage, t } from "../texts/text.js";
import { captions, hasBoard, servoIds, welcome } from "./robot.js";

/** @typedef {import("../figure/figure.js").FigureData} FigureData */
/** @typedef {import("../link/link.js").Link} Link */

const TEMPLATES = ["humanoid-16", "arm-6", "quadruped-12", "hexapod-18"];

/** Figures to choose from for robots without a figure. */
export const templates = signal(/** @type {Figure[]} */ ([]));
/** Figure fitted to this robot or loaded with a project file; null without one. */
export const ownFigure = signal(/** @type {FigureData | null} */ (null));

/** Figure of the robot: own figure, or template with the same servos; null without a figure. */
export const figure = computed(() => {
  const ids = servoIds.value.join();
  if (ownFigure.value !== null) return new Figure(ownFigure.value);
  return templates.value.find((each) => each.servoIds.join() === ids) ?? null;
});

/**
 * Follow changes of the figure of this robot, by any page, from now on.
 * @param {Link} link
 */
export function followFigure(link) {
  link.on("studio.figure", ({ figure: data }) => (ownFigure.value = data));
  effect(() => {
    if (welcome.value === null || !hasBoard.value) return;
    link.call("studio.figure.get").then(
      (answer) => (ownFigure.value = answer.figure),
      () => {},
    ); // the connection is lost
  });
}

/**
 * Keep a figure for this robot, null for a template. Rejects with RequestError or LinkLost.
 * @param {Link} link
 * @param {FigureData | null} data
 */
export async function saveFigure(link, data) {
  const answer = await link.call("studio.figure.save", { figure: data });
  ownFigure.value = answer.figure;
}

/** The servos of each limb, those of the robot's right first; servos without a limb come last, as limb "". */
export const limbs = computed(() => {
  const found = figure.value,
    ids = servoIds.value;
  const known = found === null ? [] : Object.keys(found.data.groups ?? {});
  const limbOf = (/** @type {number} */ id) => found?.byServo.get(id)?.group ?? "";
  return [...known, ""]
    .map((limb) => ({ limb, ids: ids.filter((id) => limbOf(id) === limb) }))
    .filter(({ ids }) => ids.length > 0);
});

/** Load the templates that come with the studio. */
export async function loadTemplates() {
  const loaded = await Promise.all(
    TEMPLATES.map(async (name) => new Figure(await (await fetch(`figures/${name}.figure.json`)).json())),
  );
  templates.value = loaded;
}

/**
 * Return the name of a servo.
 * @param {number} id
 */
export const nameOf = (id) => safeText(captions.value[id] ?? "") || t("live.servo", { id });

/**
 * Return the servos of a project and of the robot, with their captions and the parts of the figure that they turn.
 * @param {import("./records.js").Project} project
 */
export function namedServos(project) {
  const captionOf = new Map(project.servo_parameters.map((one) => [one.servo_id, one.servo_caption]));
  const partOf = new Map(figure.value?.joints.map(({ servo, id }) => [servo ?? -1, id]));
  const ids = [...new Set([...servoIds.value, ...captionOf.keys()])].sort((a, b) => a - b);
  return ids.map((id) => ({ id, caption: captionOf.get(id) ?? "", part: partOf.get(id) ?? "" }));
}

/**
 * Return the name of a limb.
 * @param {string} limb
 */
export const limbName = (limb) =>
  safeText(inLanguage(figure.value?.data.groups?.[limb] ?? {}) ?? "") || t("live.others");

/**
 * Return the limb of a servo; each limb has its colour.
 * @param {number} id
 */
export const limbOf = (id) => figure.value?.byServo.get(id)?.group ?? "";

/**
 * Return lowest and highest angle of a servo, degrees.
 * @param {number} id
 * @returns {[number, number]}
 */
export const limitsOf = (id) => figure.value?.byServo.get(id)?.limits ?? [-180, 180];
