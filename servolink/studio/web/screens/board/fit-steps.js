// Questions about one servo: the part, the direction, the zero and the limits.

import { html, useEffect, useRef } from "../../html.js";
import { HoldButton } from "../../parts/hold-button.js";
import { Icon } from "../../parts/icon.js";
import { NumberField } from "../../parts/number-field.js";
import { safeText } from "../../parts/safe-text.js";
import { Segments } from "../../parts/segments.js";
import { nameOf } from "../../state/figure.js";
import { assigned, changed, jointOf } from "../../state/fitting.js";
import { servoIds, servos } from "../../state/robot.js";
import { partName } from "../../texts/parts.js";
import { degrees, t } from "../../texts/text.js";

/** @typedef {import("../../state/fitting.js").Fit} Fit */
/** @typedef {import("../../state/motion.js").Motion} Motion */
/** @typedef {{ fit: Fit, servo: number, motion: Motion, onServo: (id: number) => void, onFit: (fit: Fit) => void }} Props */

const WIGGLE = 6; // degrees to each side
const SWING = 0.5; // seconds from one side to the other
const MOST_SWINGS = 40;
const FULL_TURN = 360;

/** @param {Props} props */
export function FitSteps({ fit, servo, motion, onServo, onFit }) {
  const joint = jointOf(fit, servo),
    limits = joint?.limits ?? [-180, 180];
  /** @param {import("../../state/fitting.js").Change} change */
  const change = (change) => joint && onFit(changed(fit, joint.id, change));
  return html`<${ServoChoice} fit=${fit} servo=${servo} onServo=${onServo} />
    <div class="row wrap"><${Wiggle} key=${servo} servo=${servo} motion=${motion} /></div>
    <p class="mut">${t("figure.wiggle_hint")}</p>
    <h2>${t("figure.which")}</h2>
    <select class="inp" aria-label=${t("figure.which")} onChange=${(/** @type {Event} */ event) => onFit(assigned(fit, servo, valueOf(event) || null))}>
      <option value="" selected=${joint === null}>${t("figure.nothing")}</option>
      ${fit.parts.map((id) => html`<option key=${id} value=${id} selected=${id === joint?.id}>${safeText(partName(id))}</option>`)}
    </select>
    <p class="mut">${t("figure.which_hint")}</p>
    ${
      joint &&
      html`<h2>${t("figure.way")}</h2>
      <${Segments} label=${t("figure.way")} small value="same" onChoose=${(/** @type {string} */ way) => way === "other" && change({ sign: joint.sign === -1 ? 1 : -1 })}
        choices=${[
          { value: "same", label: t("figure.same_way") },
          { value: "other", label: t("figure.other_way") },
        ]} />
      <div class="angles">
        <label class="field"><span>${t("figure.offset")} <small class="mut">${t("figure.offset_hint")}</small></span>
          <${NumberField} label=${t("figure.offset")} value=${joint.offset ?? 0} format=${degrees} step=${5} low=${-FULL_TURN} high=${FULL_TURN} onChange=${(/** @type {number} */ offset) => change({ offset })} /></label>
        <label class="field"><span>${t("figure.low")}</span>
          <${NumberField} label=${t("figure.low")} value=${limits[0]} format=${degrees} low=${-FULL_TURN} high=${limits[1]} onChange=${(/** @type {number} */ low) => change({ limits: [low, limits[1]] })} /></label>
        <label class="field"><span>${t("figure.high")}</span>
          <${NumberField} label=${t("figure.high")} value=${limits[1]} format=${degrees} low=${limits[0]} high=${FULL_TURN} onChange=${(/** @type {number} */ high) => change({ limits: [limits[0], high] })} /></label>
      </div>`
    }`;
}

/** @param {{ fit: Fit, servo: number, onServo: (id: number) => void }} props */
function ServoChoice({ fit, servo, onServo }) {
  const ids = servoIds.value,
    at = ids.indexOf(servo);
  const part = (/** @type {number} */ id) => safeText(partName(jointOf(fit, id)?.id ?? "")) || t("figure.nothing");
  return html`<div class="row">
    <button class="btn ic" aria-label=${t("figure.before")} disabled=${at <= 0} onClick=${() => onServo(ids[at - 1])}><${Icon} name="left" /></button>
    <select class="inp grow" aria-label=${t("figure.servo")} onChange=${(/** @type {Event} */ event) => onServo(Number(valueOf(event)))}>
      ${ids.map((id) => html`<option key=${id} value=${id} selected=${id === servo}>${t("figure.servo_option", { id, caption: nameOf(id), part: part(id) })}</option>`)}
    </select>
    <button class="btn ic" aria-label=${t("figure.next")} disabled=${at >= ids.length - 1} onClick=${() => onServo(ids[at + 1])}><${Icon} name="right" /></button>
  </div>`;
}

/**
 * Button that turns a servo a little to and fro while it is held.
 * @param {{ servo: number, motion: Motion }} props
 */
export function Wiggle({ servo, motion }) {
  const middle = useRef(/** @type {number | null} */ (null)); // centre of every wiggle, so that the servo does not wander
  useEffect(() => () => motion.end(), []);
  const start = async () => {
    if (!(await motion.begin())) return;
    middle.current ??= servos.value.get(servo)?.angle ?? 0;
    const around = middle.current;
    const swings = Array.from({ length: MOST_SWINGS }, (_, number) => ({
      at: number * SWING,
      duration: SWING,
      targets: { [servo]: around + (number % 2 === 0 ? WIGGLE : -WIGGLE) },
    }));
    if (await motion.play(swings, MOST_SWINGS * SWING)) motion.end();
  };
  return html`<${HoldButton} label=${t("figure.wiggle", { id: servo })} onBegin=${start} onEnd=${() => motion.end()} />`;
}

/** @param {Event} event */
const valueOf = (event) => /** @type {HTMLSelectElement} */ (event.currentTarget).value;
