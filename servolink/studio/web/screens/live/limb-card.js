// A card with the servos of one limb.

import { html } from "../../html.js";
import { limbName } from "../../state/figure.js";
import { t } from "../../texts/text.js";
import { ServoRow } from "./servo-row.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

const FEW = 3;

/** @param {{ limb: string, ids: number[], isShown: boolean } & Tools} props */
export function LimbCard({ limb, ids, isShown, ...tools }) {
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
