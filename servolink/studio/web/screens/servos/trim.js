// Correction of the angle of a servo: nudged until the part stands right, or typed.

import { html, useEffect, useState } from "../../html.js";
import { Hold } from "../../parts/hold.js";
import { NumberField } from "../../parts/number-field.js";
import { refusal } from "../../state/motion.js";
import { Nudges } from "../../state/nudging.js";
import { isFresh, isOthers, mayMove, servos } from "../../state/robot.js";
import {
  beginNudging,
  corrected,
  endSetup,
  MOST_TRIM,
  nudged,
  parameterOf,
  trimServo,
} from "../../state/servo-setup.js";
import { safeText } from "../../parts/safe-text.js";
import { t } from "../../texts/text.js";
import { signed } from "./index.js";

/** @typedef {import("../../state/motion.js").Motion} Motion */

const WAYS = [-5, -1, 1, 5]; // degrees

/** @param {{ id: number, motion: Motion }} props */
export function TrimCard({ id, motion }) {
  const trim = parameterOf(id).adjusted_degree,
    from = nudged.value?.id === id ? nudged.value.from : null;
  const [nudges] = useState(() => new Nudges(motion, id));
  useEffect(() => () => motion.end(), []);
  const keep = () => {
    if (from !== null) trimServo(id, corrected(trim, from, servos.value.get(id)?.angle ?? from));
    endSetup();
  };
  return html`<section class="card" aria-labelledby="trim-title">
    <header><h2 id="trim-title">${t("servos.trim")}</h2></header>
    <div class="pad0 stack">
      <p class="mut">${t("servos.trim_hint")}</p>
      ${refusal.value && html`<span class="chip bad" role="alert">${safeText(refusal.value)}</span>`}
      ${
        mayMove.value &&
        html`<div class="nudges">${WAYS.map((way) => html`<${Nudge} key=${way} id=${id} way=${way} nudges=${nudges} />`)}</div>
        <div><button class="btn s pri" disabled=${from === null} onClick=${keep}>${t("servos.stands_right")}</button></div>`
      }
      <label class="field"><span>${t("servos.trim_value")}</span>
        <${NumberField} label=${t("servos.trim_value")} value=${trim} format=${signed} low=${-MOST_TRIM} high=${MOST_TRIM} onChange=${(/** @type {number} */ degree) => trimServo(id, Math.round(degree))} />
      </label>
    </div>
  </section>`;
}

/**
 * Button that moves a servo by some degrees, and on while it is held.
 * @param {{ id: number, way: number, nudges: Nudges }} props
 */
function Nudge({ id, way, nudges }) {
  const begin = () => {
    beginNudging(id);
    nudges.press(way);
  };
  const isOff = !isFresh.value || isOthers.value;
  return html`<${Hold} label=${signed(way)} hint=${t("servos.nudge", { way: signed(way) })} classes="small" hasKey=${false} disabled=${isOff} onBegin=${begin} onEnd=${() => nudges.release()} />`;
}
