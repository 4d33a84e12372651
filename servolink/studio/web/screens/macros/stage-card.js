// The figure plays the macro; the robot does so while it is held.

import { html, useMemo } from "../../html.js";
import { HoldButton } from "../../parts/hold-button.js";
import { Icon } from "../../parts/icon.js";
import { FigureStage } from "../../parts/stage.js";
import { ViewChoice } from "../../parts/view-choice.js";
import { figure } from "../../state/figure.js";
import { chooseServo, chosen, views } from "../../state/view.js";
import { t } from "../../texts/text.js";
import { course } from "../../state/shown-macro.js";
import { isRunning, pose, runOnRobot } from "../../state/macro-preview.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function StageCard({ motion }) {
  const scene = useMemo(() => ({ pose, chosen: () => chosen.value, onPick: chooseServo }), []);
  const isEmpty = course.value === null || course.value.isCut || course.value.turns.length === 0;
  return html`<section class="stage" aria-label=${t("macros.preview")}>
    ${figure.value && html`<${FigureStage} figure=${figure.value} scene=${scene} label=${t("macros.preview")} view=${views.macros.value} />`}
    <div class="tl col"><${ViewChoice} of="macros" /></div>
    <div class="tr">
      ${
        isRunning.value
          ? html`<span class="chip warn" role="status"><${Icon} name="live" />${t("macros.running")}</span>`
          : html`<span class="chip acc"><${Icon} name="eye" />${t("macros.preview_only")}</span>`
      }
    </div>
    <div class="br"><${HoldButton} label=${t("macros.hold_to_run")} disabled=${isEmpty} onBegin=${() => runOnRobot(motion)} onEnd=${() => motion.end()} /></div>
  </section>`;
}
