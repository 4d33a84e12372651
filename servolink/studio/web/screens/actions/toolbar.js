// What changes the whole action.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { NumberField } from "../../parts/number-field.js";
import { LONGEST, secondsOf } from "../../state/records.js";
import { isLive } from "../../state/robot.js";
import { seconds, t } from "../../texts/text.js";
import { copyRight, mirrorAction, take, timeForAll } from "./commands.js";
import { action, mirror } from "../../state/shown-action.js";

export function Toolbar() {
  const one = action.value,
    hasSides = mirror.value.size > 0,
    reason = hasSides ? undefined : t("actions.no_sides");
  if (one === null) return null;
  return html`<div class="card toolbar" role="toolbar" aria-label=${t("actions.tools")}>
    <button class="btn" disabled=${!hasSides} title=${reason} onClick=${mirrorAction}>
      <${Icon} name="mirror" />${t("actions.mirror")} <kbd class="hide-t hide-n">M</kbd>
    </button>
    <button class="btn" disabled=${!hasSides} title=${reason} onClick=${copyRight}>
      <${Icon} name="copy" /><span>${t("actions.copy_right")}</span>
    </button>
    <button class="btn" disabled=${!isLive.value} onClick=${take}><${Icon} name="camera" /><span>${t("actions.take")}</span></button>
    <span class="grow"></span>
    <label class="row allin">
      <span class="mut">${t("actions.all_in")}</span>
      <${NumberField} value=${secondsOf(one)} format=${seconds} step=${0.01} low=${0} high=${LONGEST / 1000} label=${t("actions.time_for_all")} onChange=${timeForAll} />
    </label>
  </div>`;
}
