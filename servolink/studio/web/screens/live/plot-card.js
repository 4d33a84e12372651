// What all servos did in the last seconds.

import { html } from "../../html.js";
import { Plot } from "../../parts/plot.js";
import { Segments } from "../../parts/segments.js";
import { limbOf } from "../../state/figure.js";
import { history, servoIds } from "../../state/robot.js";
import { theme } from "../../state/settings.js";
import { chosen, plotQuantity, plottedQuantity } from "../../state/view.js";
import { t } from "../../texts/text.js";

const SECONDS = 12;

export function PlotCard() {
  return html`<section class="card plotcard">
    <header>
      <${Segments} label=${t("live.plot")} small value=${plottedQuantity.value} onChoose=${plotQuantity}
        choices=${[
          { value: "angle", label: t("live.angle") },
          { value: "current_raw", label: t("live.current_title") },
          { value: "temperature_raw", label: t("live.temperature_title") },
        ]} />
      <span class="grow"></span>
      <span class="chip hide-n">${t("live.last_seconds", { seconds: SECONDS })}</span>
    </header>
    <${Plot} history=${history} ids=${servoIds.value} quantity=${plottedQuantity.value} seconds=${SECONDS} chosen=${chosen.value}
      limbOf=${limbOf} unit=${plottedQuantity.value === "angle" ? "°" : ""} label=${t("live.plot")} nowLabel=${t("live.now")} look=${theme.value} />
  </section>`;
}
