// Direction from which the figure of a screen is seen.

import { html } from "../html.js";
import { lookFrom, views } from "../state/view.js";
import { t } from "../texts/text.js";
import { Segments } from "./segments.js";

/** @param {{ of: keyof typeof views }} props */
export function ViewChoice({ of }) {
  return html`<${Segments} label=${t("live.view")} small value=${views[of].value} onChoose=${(/** @type {import("../state/view.js").ViewName} */ name) => lookFrom(of, name)}
    choices=${[
      { value: "front", label: t("live.front") },
      { value: "side", label: t("live.side") },
      { value: "free", label: t("live.free") },
    ]} />`;
}
