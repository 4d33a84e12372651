// Fits a figure to the robot, servo by servo: a small movement, and the question which part of the robot moved.

import { Figure } from "../../figure/figure.js";
import { html, signal, useMemo } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Segments } from "../../parts/segments.js";
import { FigureStage } from "../../parts/stage.js";
import { toast } from "../../parts/toasts.js";
import { safeText } from "../../parts/safe-text.js";
import { figure, ownFigure, saveFigure, templates } from "../../state/figure.js";
import { assigned, begin, drawn, drawnPose, jointOf } from "../../state/fitting.js";
import { actualPose, servoIds } from "../../state/robot.js";
import { t } from "../../texts/text.js";
import { FitSteps } from "./fit-steps.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */
/** @typedef {import("../../state/fitting.js").Fit} Fit */

const NAMES = /** @type {const} */ (["figure.humanoid", "figure.arm", "figure.quadruped", "figure.hexapod"]);
const PALE = { tint: /** @type {import("../../figure/matrix.js").Vector} */ ([0.6, 0.62, 0.64]), amount: 0.8 };

/** The figure that is being fitted, null for none. */
export const fit = signal(/** @type {Fit | null} */ (null));
/** The servo that is asked about. */
const asked = signal(0);
/** Which of the templates it began with, -1 for the figure as it was. */
const origin = signal(0);

/** Begin with the figure as it is, or with a template if there is none. */
export function beginFit() {
  const count = servoIds.value.length;
  const closest = templates.value.map(({ servoIds: ids }) => Math.abs(ids.length - count));
  asked.value = servoIds.value[0] ?? 0;
  start(figure.value ? -1 : closest.indexOf(Math.min(...closest)));
}

/** @param {number} number of the template */
function start(number) {
  origin.value = number;
  const from = number < 0 ? figure.value : templates.value[number];
  if (from) fit.value = begin(from.data, servoIds.value);
}

/** @param {Tools} tools */
export function FitCard({ link, motion }) {
  const now = /** @type {Fit} */ (fit.value);
  const save = async () => {
    try {
      await saveFigure(link, { ...now.data, name: nameOfFit() });
      fit.value = null;
      toast({ kind: "ok", title: t("figure.saved") });
    } catch (error) {
      toast({ kind: "bad", title: safeText(error instanceof Error ? error.message : "") });
    }
  };
  const choices = NAMES.map((key, number) => ({ value: String(number), label: t(key) }));
  if (figure.value) choices.unshift({ value: "-1", label: t("figure.own") });
  return html`<div class="fit">
    <section class="stage"><${FitStage} now=${now} /></section>
    <section class="card">
      <header class="wrap"><h1>${t("figure.fit")}</h1>
        <button class="btn" onClick=${() => (fit.value = null)}>${t("figure.cancel")}</button>
        <button class="btn pri" onClick=${save}><${Icon} name="save" />${t("figure.save")}</button>
      </header>
      <div class="pad0 stack">
        <h2>${t("figure.begin_with")}</h2>
        <${Segments} label=${t("figure.begin_with")} small value=${String(origin.value)} onChoose=${(/** @type {string} */ value) => start(Number(value))} choices=${choices} />
        <${FitSteps} fit=${now} servo=${asked.value} motion=${motion} onServo=${(/** @type {number} */ id) => (asked.value = id)} onFit=${(/** @type {Fit} */ next) => (fit.value = next)} />
      </div>
    </section>
  </div>`;
}

/** @param {{ now: Fit }} props */
function FitStage({ now }) {
  const shown = useMemo(() => new Figure(drawn(now)), [now]);
  const scene = {
    pose: () => drawnPose(now, actualPose()),
    chosen: () => numberOf(now, jointOf(now, asked.value)?.id),
    tintOf: (/** @type {import("../../figure/figure.js").Joint} */ joint) =>
      now.data.joints[joint.servo ?? -1]?.servo === undefined && joint.servo !== undefined ? PALE : null,
    onPick: (/** @type {number} */ number) => (fit.value = assigned(now, asked.value, now.data.joints[number].id)),
  };
  return html`<${FigureStage} figure=${shown} scene=${scene} label=${t("figure.aria")} />`;
}

/**
 * @param {Fit} now
 * @param {string | undefined} id
 */
function numberOf(now, id) {
  const number = now.data.joints.findIndex((joint) => joint.id === id);
  return number < 0 ? null : number;
}

/** Return what the figure is called. */
const nameOfFit = () =>
  (origin.value < 0 ? ownFigure.value?.name : templates.value[origin.value].data.name) ?? figure.value?.data.name ?? "";
