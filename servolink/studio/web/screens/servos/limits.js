// Limits of a servo, from moving it by hand, kept in the profile of the board.

import { html } from "../../html.js";
import { NumberField } from "../../parts/number-field.js";
import { safeText } from "../../parts/safe-text.js";
import { RequestError } from "../../link/link.js";
import { limitsOf } from "../../state/figure.js";
import { isFresh, isLocalEditor } from "../../state/robot.js";
import { endSetup, keepLimits, measure, measured, profileLimits } from "../../state/servo-setup.js";
import { toast } from "../../state/toasts.js";
import { degrees, t } from "../../texts/text.js";

/** @typedef {import("../../state/servo-setup.js").Range} Range */

const WIDEST = 360; // degrees to each side

/** @param {{ id: number, link: import("../../link/link.js").Link }} props */
export function LimitsCard({ id, link }) {
  const kept = profileLimits.value[id] ?? null,
    range = measured.value?.id === id ? measured.value.range : null;
  /** @param {Range | null} next */
  const keep = async (next) => {
    try {
      await keepLimits(link, id, next);
      endSetup();
      toast({
        kind: "ok",
        title: t(next === null ? "servos.limits_gone" : "servos.limits_kept"),
        detail: t("servos.limits_later"),
      });
    } catch (error) {
      const detail = error instanceof RequestError ? error.remedy : "";
      toast({ kind: "bad", title: safeText(error instanceof Error ? error.message : ""), detail: safeText(detail) });
    }
  };
  const [low, high] = kept ?? limitsOf(id);
  const mayKeep = isLocalEditor.value;
  return html`<section class="card" aria-labelledby="limits-title">
    <header><h2 id="limits-title">${t("servos.limits")}</h2>
      <span class=${kept ? "chip ok num" : "chip"}>${kept ? `${degrees(low)} … ${degrees(high)}` : t("servos.no_limits")}</span>
    </header>
    <div class="pad0 stack">
      ${mayKeep && html`<p class="mut">${t("servos.limits_hint")}</p>`}
      ${
        mayKeep &&
        (range === null
          ? html`<div><button class="btn s" disabled=${!isFresh.value} onClick=${() => measure(id)}>${t("servos.measure")}</button></div>`
          : html`<p class="num" role="status"><b>${degrees(range[0])} … ${degrees(range[1])}</b> <span class="mut">${t("servos.measuring")}</span></p>
            <div class="row wrap">
              <button class="btn s pri" disabled=${range[0] === range[1]} onClick=${() => keep(range)}>${t("servos.keep_limits")}</button>
              <button class="btn s" onClick=${endSetup}>${t("figure.cancel")}</button>
            </div>`)
      }
      ${
        mayKeep &&
        html`<div class="angles">
          <label class="field"><span>${t("figure.low")}</span>
            <${NumberField} label=${t("figure.low")} value=${low} format=${degrees} low=${-WIDEST} high=${high} onChange=${(/** @type {number} */ angle) => keep([angle, high])} /></label>
          <label class="field"><span>${t("figure.high")}</span>
            <${NumberField} label=${t("figure.high")} value=${high} format=${degrees} low=${low} high=${WIDEST} onChange=${(/** @type {number} */ angle) => keep([low, angle])} /></label>
        </div>`
      }
      ${kept && mayKeep && html`<div><button class="btn s" onClick=${() => keep(null)}>${t("servos.drop_limits")}</button></div>`}
    </div>
  </section>`;
}
