// From where a figure is seen.

import { html } from "../html.js";
import { t } from "../texts/text.js";
import { Segments } from "./segments.js";

/** @param {{ view: { value: import("./stage.js").ViewName } }} props */
export function ViewChoice({ view }) {
  return html`<${Segments} label=${t("live.view")} small value=${view.value} onChoose=${(/** @type {typeof view.value} */ name) => (view.value = name)}
    choices=${[
      { value: "front", label: t("live.front") },
      { value: "side", label: t("live.side") },
      { value: "free", label: t("live.free") },
    ]} />`;
}
