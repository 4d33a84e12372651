// The robot with its limp limbs in orange, and the pose of the film that is chosen, pale.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { FigureStage } from "../../parts/stage.js";
import { ViewChoice } from "../../parts/view-choice.js";
import { figure, limbName, limbOf, limbs } from "../../state/figure.js";
import { actualPose, servos } from "../../state/robot.js";
import { chosenLimbs, chosenPose, film, isLimp, previewPose, previewTime, toggleLimb } from "../../state/teaching.js";
import { views } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { released } from "../../state/limp.js";

/** @typedef {import("../../figure/matrix.js").Vector} Vector */

const LIMP = /** @type {Vector} */ ([0.82, 0.41, 0.12]);

export function StageCard() {
  const names = limbs.value
    .filter(({ ids }) => ids.some((id) => released.value.has(id)))
    .map(({ limb }) => limbName(limb));
  return html`<section class="stage" aria-label=${t("teach.stage")}>
    ${figure.value && html`<${FigureStage} figure=${figure.value} scene=${SCENE} label=${t("teach.stage_aria")} view=${views.teach.value} />`}
    <div class="tl col">
      <${ViewChoice} of="teach" />
      ${names.length > 0 && html`<span class="chip limp"><${Icon} name="feather" />${t("teach.limp", { limbs: names.join(", ") })}</span>`}
    </div>
    <div class="tr">
      ${
        previewTime.value !== null
          ? html`<span class="chip acc"><${Icon} name="eye" />${t("teach.preview_only")}</span>`
          : html`<span class="chip">${isLimp.value ? t("teach.rest_held") : t("teach.all_held")}</span>`
      }
    </div>
  </section>`;
}

const isPreview = () => previewTime.value !== null;

/** @type {import("../../figure/stage.js").Scene} */
const SCENE = {
  pose: () => previewPose() ?? actualPose(),
  ghost: () => (isPreview() || chosenPose.value === null ? null : (film.value[chosenPose.value]?.pose ?? null)),
  tintOf: ({ servo, follows, group }) => {
    const state = servos.value.get(servo ?? follows ?? -1);
    if (isPreview() || state === undefined) return null;
    if (!state.is_hold) return { tint: LIMP, amount: 0.8 };
    return !isLimp.value && chosenLimbs.value.has(group) ? { tint: LIMP, amount: 0.35 } : null;
  },
  onPick: (id) => toggleLimb(limbOf(id)),
};
