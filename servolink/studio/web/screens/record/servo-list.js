// The servos by limb, and which of them are plotted.

import { html } from "../../html.js";
import { limbName, limbs, nameOf } from "../../state/figure.js";
import { servoIds, servos } from "../../state/robot.js";
import { t } from "../../texts/text.js";
import { plotServos, plotted } from "../../state/recording.js";

export function ServoList() {
  const isAll = plotted.value.length === servoIds.value.length;
  return html`<section class="card ser">
    <header><h2>${t("record.plotted")}</h2><button class="btn s" onClick=${() => plotServos(servoIds.value, !isAll)}>${isAll ? t("record.none") : t("record.all")}</button></header>
    <div class="pad0">
      ${limbs.value.map(
        ({ limb, ids }) => html`<fieldset key=${limb} data-g=${limb}>
        <legend>${limbName(limb)}</legend>
        ${ids.map((id) => html`<${Servo} key=${id} id=${id} />`)}
      </fieldset>`,
      )}
    </div>
  </section>`;
}

/** @param {{ id: number }} props */
function Servo({ id }) {
  const isPlotted = plotted.value.includes(id);
  return html`<label>
    <input type="checkbox" checked=${isPlotted} onChange=${() => plotServos([id], !isPlotted)} />
    <span class="grow">${nameOf(id)}</span>
    <${Angle} id=${id} />
  </label>`;
}

/** @param {{ id: number }} props */
const Angle = ({ id }) =>
  html`<span class="num mut">${String(servos.value.get(id)?.angle ?? "").replace("-", "\u2212")}°</span>`;
