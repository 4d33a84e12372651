// Live: present pose of the robot, every servo beside the limb, and the last seconds.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Plot } from "../../parts/plot.js";
import { Segments } from "../../parts/segments.js";
import { limbName, limbOf, limbs, nameOf } from "../../state/figure.js";
import { history, isFresh, isLive, servoIds } from "../../state/robot.js";
import { theme } from "../../state/settings.js";
import { chosen, plotQuantity, plottedQuantity, showLimb, shownLimb } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { RecordMacro } from "./record.js";
import { Inspector } from "./inspector.js";
import { ServoRow } from "./servo-row.js";
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
      <${PlotCard} link=${tools.link} />
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

// A card with the servos of one limb.

const FEW = 3;

/** @param {{ limb: string, ids: number[], isShown: boolean } & Tools} props */
function LimbCard({ limb, ids, isShown, ...tools }) {
  const classes = ["card limb", ids.length <= FEW ? "three" : "", isShown ? "show" : ""].join(" ");
  return html`<section class=${classes} data-g=${limb} aria-label=${limbName(limb)}>
    <header>
      <span class="gd"></span>
      <h2>${limbName(limb)}</h2>
      <span class="cols" aria-hidden="true"><span>${t("live.current_short")}</span><span>${t("live.temperature_short")}</span></span>
    </header>
    <ul>
      ${ids.map((id) => html`<${ServoRow} key=${id} id=${id} ...${tools} />`)}
    </ul>
  </section>`;
}

// Plot of all servos over the last seconds, and the names of the limbs in its colours.

const Legend = () => html`<ul class="plotlegend grow" aria-label=${t("live.legend")}>
  ${limbs.value.map(({ limb }) => html`<li key=${limb} data-g=${limb}><span class="gd"></span>${limbName(limb)}</li>`)}
  ${chosen.value !== null && html`<li class="now" data-g=${limbOf(chosen.value)}><span class="gd wide"></span><b>${nameOf(chosen.value)}</b></li>`}
</ul>`;

const SECONDS = 12;

/** @param {{ link: import("../../link/link.js").Link }} props */
function PlotCard({ link }) {
  return html`<section class="card plotcard">
    <header>
      <${Segments} label=${t("live.plot")} small value=${plottedQuantity.value} onChoose=${plotQuantity}
        choices=${[
          { value: "angle", label: t("live.angle") },
          { value: "current_raw", label: t("live.current_title") },
          { value: "temperature_raw", label: t("live.temperature_title") },
        ]} />
      <${Legend} />
      <${RecordMacro} link=${link} />
      <span class="chip hide-n">${t("live.last_seconds", { seconds: SECONDS })}</span>
    </header>
    <${Plot} history=${history} ids=${servoIds.value} quantity=${plottedQuantity.value} seconds=${SECONDS} chosen=${chosen.value}
      limbOf=${limbOf} unit=${plottedQuantity.value === "angle" ? "°" : ""} label=${t("live.plot")} nowLabel=${t("live.now")} look=${theme.value} />
  </section>`;
}
