// What all servos did in the last seconds.

import { html, signal } from "../../html.js";
import { Plot } from "../../parts/plot.js";
import { Segments } from "../../parts/segments.js";
import { limbOf } from "../../state/figure.js";
import { history, servoIds } from "../../state/robot.js";
import { theme } from "../../state/settings.js";
import { chosen } from "../../state/view.js";
import { t } from "../../texts/text.js";

const SECONDS = 12;

const quantity = signal(/** @type {import("../../state/history.js").Quantity} */ ("angle"));

export function PlotCard() {
  return html`<section class="card plotcard">
    <header>
      <${Segments} label=${t("live.plot")} small value=${quantity.value} onChoose=${(/** @type {typeof quantity.value} */ name) => (quantity.value = name)}
        choices=${[
          { value: "angle", label: t("live.angle") },
          { value: "current_raw", label: t("live.current_title") },
          { value: "temperature_raw", label: t("live.temperature_title") },
        ]} />
      <span class="grow"></span>
      <span class="chip hide-n">${t("live.last_seconds", { seconds: SECONDS })}</span>
    </header>
    <${Plot} history=${history} ids=${servoIds.value} quantity=${quantity.value} seconds=${SECONDS} chosen=${chosen.value}
      limbOf=${limbOf} unit=${quantity.value === "angle" ? "°" : ""} label=${t("live.plot")} nowLabel=${t("live.now")} look=${theme.value} />
  </section>`;
}
