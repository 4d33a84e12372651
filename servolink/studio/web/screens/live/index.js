// Live: the robot as it is now, every servo beside its limb, and what happened in the last seconds.

import { html } from "../../html.js";
import { limbName, limbs } from "../../state/figure.js";
import { isFresh, isLive, servoIds } from "../../state/robot.js";
import { showLimb, shownLimb } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { Icon } from "../../parts/icon.js";
import { Inspector } from "./inspector.js";
import { LimbCard } from "./limb-card.js";
import { PlotCard } from "./plot-card.js";
import { StageCard } from "./stage-card.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function LiveScreen(tools) {
  if (isLive.value && servoIds.value.length === 0) return html`<${NoServos} />`;
  const all = limbs.value;
  const shown = all.some(({ limb }) => limb === shownLimb.value) ? shownLimb.value : all[0]?.limb;
  const [left, right] = columns(all);
  /** @param {typeof all} some */
  const cards = (some) =>
    some.map((each) => html`<${LimbCard} key=${each.limb} ...${each} ...${tools} isShown=${each.limb === shown} />`);
  return html`<h1 class="sr">${t("screen.live")}</h1>
    <div class=${isFresh.value ? "live" : "live stale"}>
      <div class="limbs lc">${cards(left)}</div>
      <${StageCard} ...${tools} />
      <div class="limbtabs seg only-n" role="group" aria-label=${t("live.figure")}>
        ${all.map(
          ({ limb }) => html`<button aria-pressed=${String(limb === shown)} onClick=${() => showLimb(limb)}>
            ${limbName(limb)}
          </button>`,
        )}
      </div>
      <div class="limbs rc">${cards(right)}</div>
      <${PlotCard} />
      <${Inspector} ...${tools} />
    </div>`;
}

/**
 * Return the limbs in the left and in the right column. The robot faces you, so its right is on your left.
 * @template {{ limb: string }} L
 * @param {L[]} all
 * @returns {[L[], L[]]}
 */
function columns(all) {
  const isRight = (/** @type {L} */ { limb }) => limb.startsWith("r");
  return [all.filter(isRight), all.filter((each) => !isRight(each))];
}

const NoServos = () => html`<div class="card empty">
  <${Icon} name="live" />
  <h1>${t("live.no_servos")}</h1>
  <p>${t("live.no_servos_detail")}</p>
</div>`;
