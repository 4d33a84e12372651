// Fits a figure to the robot, servo by servo: a small movement, and the question which part of the robot moved.

import { html, useMemo } from "../../html.js";
import { Figure } from "../../figure/figure.js";
import { Icon } from "../../parts/icon.js";
import { safeText } from "../../parts/safe-text.js";
import { Segments } from "../../parts/segments.js";
import { FigureStage } from "../../parts/stage.js";
import { figure, saveFigure, templates } from "../../state/figure.js";
import {
  asked,
  askAbout,
  assigned,
  changeFit,
  drawn,
  drawnPose,
  endFit,
  fit,
  fitFrom,
  jointOf,
  nameOfFit,
  origin,
} from "../../state/fitting.js";
import { actualPose } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";
import { FitSteps } from "./fit-steps.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */
/** @typedef {import("../../state/fitting.js").Fit} Fit */

const NAMES = /** @type {const} */ (["figure.humanoid", "figure.arm", "figure.quadruped", "figure.hexapod"]);
const PALE = { tint: /** @type {import("../../figure/matrix.js").Vector} */ ([0.6, 0.62, 0.64]), amount: 0.8 };

/**
 * Return the name of a figure, translated for the figures of the studio.
 * @param {Figure} shown
 */
export function figureName({ data: { name } }) {
  const at = templates.value.findIndex((each) => each.data.name === name);
  return at < 0 ? safeText(name) : t(NAMES[at]);
}

/** @param {Tools} tools */
export function FitCard({ link, motion }) {
  const now = /** @type {Fit} */ (fit.value);
  const save = async () => {
    try {
      await saveFigure(link, { ...now.data, name: nameOfFit() });
      endFit();
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
        <button class="btn" onClick=${endFit}>${t("figure.cancel")}</button>
        <button class="btn pri" onClick=${save}><${Icon} name="save" />${t("figure.save")}</button>
      </header>
      <div class="pad0 stack">
        <h2>${t("figure.begin_with")}</h2>
        <${Segments} label=${t("figure.begin_with")} small value=${String(origin.value)} onChoose=${(/** @type {string} */ value) => fitFrom(Number(value))} choices=${choices} />
        <${FitSteps} fit=${now} servo=${asked.value} motion=${motion} onServo=${askAbout} onFit=${changeFit} />
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
    onPick: (/** @type {number} */ number) => changeFit(assigned(now, asked.value, now.data.joints[number].id)),
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
