// What is known of the board: its profile, which `servolink doctor --learn` writes. It is only shown.

import { html } from "../../html.js";
import { safeText } from "../../parts/safe-text.js";
import { servoIds, welcome } from "../../state/robot.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../texts/text.js").Key} Key */

/** Those that people understand, in this order; the others follow with their names in the file. @type {Record<string, Key>} */
const TITLES = {
  byte_order: "board.byte_order",
  caption_encoding: "board.caption_encoding",
  on_duplicate: "board.on_duplicate",
  interval_unit: "board.interval_unit",
  speed_cap: "board.speed_cap",
};

export function About() {
  const { name = "", profile } = welcome.value ?? {},
    { settings = {}, limits = {} } = profile ?? {};
  const known = Object.entries({ ...settings, ...limits }).filter(([, value]) => !isNothing(value));
  const order = Object.keys(TITLES),
    place = (/** @type {string} */ key) => (order.indexOf(key) + order.length + 1) % (order.length + 1);
  known.sort(([one], [other]) => place(one) - place(other));
  return html`<section class="card">
    <header><h2>${t("board.about")}</h2></header>
    <div class="pad0">
      <dl class="kv">
        <dt>${t("board.name")}</dt><dd>${safeText(name)}</dd>
        <dt>${t("board.servos")}</dt><dd>${servoIds.value.length}</dd>
        ${known.map(([key, value]) => html`<dt>${key in TITLES ? t(TITLES[key]) : html`<span class="mono">${safeText(key)}</span>`}</dt><dd>${safeText(textOf(value))}</dd>`)}
      </dl>
      ${known.length === 0 && html`<p class="mut">${t("board.nothing_known")}</p>`}
    </div>
  </section>`;
}

/** @param {unknown} value */
const isNothing = (value) =>
  value === null || (typeof value === "object" && Object.keys(/** @type {object} */ (value)).length === 0);

/** @param {unknown} value */
const textOf = (value) => (typeof value === "object" ? JSON.stringify(value) : String(value));
