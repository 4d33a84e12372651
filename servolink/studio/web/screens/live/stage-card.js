// The figure of the robot in the middle of the screen, with the draft beside it, pale.

import { html, useEffect, useState } from "../../html.js";
import { Hold } from "../../parts/hold.js";
import { Icon } from "../../parts/icon.js";
import { Segments } from "../../parts/segments.js";
import { FigureStage } from "../../parts/stage.js";
import { ViewChoice } from "../../parts/view-choice.js";
import { figure } from "../../state/figure.js";
import { targets } from "../../state/motion.js";
import { actualPose, isFresh, isLive, isOthers, mayMove, readAt, servos, stalled } from "../../state/robot.js";
import { canReach, endReach, reach } from "../../state/reach.js";
import { chooseMode, chooseServo, chosen, draft, dropTargets, mode, views } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { drag } from "./servo-row.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */
/** @typedef {import("../../figure/matrix.js").Vector} Vector */

const LIMP = /** @type {Vector} */ ([0.82, 0.41, 0.12]);
const STALLED = /** @type {Vector} */ ([0.86, 0.12, 0.16]);

/**
 * Return the tint of the part of a servo; null without a mark.
 * @param {import("../../state/robot.js").Servo | undefined} servo
 */
export function tintOf(servo) {
  if (servo?.is_hold === false) return { tint: LIMP, amount: 0.7 };
  if (servo !== undefined && !servo.is_start && servo.servo_id === stalled.value) return { tint: STALLED, amount: 0.8 };
  return null;
}

/** @param {Tools} tools */
export function StageCard({ motion }) {
  return html`<section class="stage" aria-label=${t("live.figure")}>
    ${figure.value && html`<${FigureStage} figure=${figure.value} scene=${scene(motion)} label=${t("live.figure_aria")} view=${views.live.value} />`}
    ${!figure.value && html`<div class="nofigure"><p class="mut">${t("figure.none")}</p><a class="btn" href="#board">${t("figure.fit")}</a></div>`}
    <div class="tl col">
      <${ViewChoice} of="live" />
      <${Draft} />
    </div>
    <div class="tr hide-n"><span class="legend">
      <span><i></i>${t("live.robot")}</span><span><i class="g"></i>${t("live.target")}</span>
    </span></div>
    <div class="bar">
      ${isFresh.value ? null : html`<${AsSeen} />`}
      ${
        mayMove.value &&
        html`<${Segments} label=${t("live.robot_mode")} value=${mode.value} onChoose=${choose}
        choices=${[
          { value: "preview", label: t("live.preview"), icon: "eye" },
          { value: "robot", label: t("live.robot_mode"), icon: "live" },
        ]} />`
      }
      ${mayMove.value && mode.value === "preview" && html`<${HoldToMove} motion=${motion} />`}
    </div>
  </section>`;
}

/** @param {{ motion: import("../../state/motion.js").Motion }} props */
function HoldToMove({ motion }) {
  const none = Object.keys(draft.value).length === 0;
  const label = !isLive.value ? t("live.no_board") : isOthers.value ? t("live.no_control") : t("live.hold_to_move");
  const begin = async () => {
    if (await motion.begin()) motion.towards(draft.value);
  };
  const end = () => motion.end();
  return html`<${Hold} label=${label} room=${t("live.hold_to_move")} hint=${t("live.hold_hint")} disabled=${none || !isFresh.value || isOthers.value} onBegin=${begin} onEnd=${end} />`;
}

function Draft() {
  const count = Object.keys(draft.value).length;
  if (count === 0 || mode.value === "robot") return null;
  return html`<button class="chip acc plain" onClick=${dropTargets}>${t("live.not_sent", { count })}</button>`;
}

function AsSeen() {
  const [, setNow] = useState(0);
  useEffect(() => {
    const timer = setInterval(() => setNow(performance.now()), 1000);
    return () => clearInterval(timer);
  }, []);
  const seconds = Math.max(0, Math.round((performance.now() - readAt.value) / 1000));
  return html`<span class="chip bad"><${Icon} name="clock" />${t("live.as_seen", { seconds })}</span>`;
}

/** @param {typeof mode.value} chosenMode */
function choose(chosenMode) {
  chooseMode(chosenMode);
  dropTargets();
}

/**
 * @param {import("../../state/motion.js").Motion} motion
 * @returns {import("../../figure/stage.js").Scene}
 */
function scene(motion) {
  const wanted = () => (mode.value === "robot" ? targets.value : draft.value);
  const canDrag = isFresh.value && mayMove.value && !(isOthers.value && mode.value === "robot");
  return {
    pose: actualPose,
    dragPose: () => ({ ...actualPose(), ...wanted() }),
    target: () => (Object.keys(wanted()).length > 0 ? { ...actualPose(), ...wanted() } : null),
    chosen: () => chosen.value,
    hasGizmo: true,
    tintOf: (joint) => tintOf(servos.value.get(joint.servo ?? -1)),
    onPick: chooseServo,
    onDrag: canDrag ? (id, angle) => drag(id, Math.round(angle), motion) : undefined,
    onGrab: () => mode.value === "robot" && motion.begin(),
    canReach: () => canDrag && mode.value === "preview" && canReach(),
    onReach: (joint, move, start) =>
      reach({ joint, move, start }, (angles) => {
        if (mode.value === "preview") for (const [id, angle] of Object.entries(angles)) drag(Number(id), angle, motion);
      }),
    onRelease: () => {
      endReach();
      if (mode.value === "robot") motion.end();
    },
  };
}
