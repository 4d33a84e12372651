// Macros: what they do in time, tried on the figure before the robot moves.

import { html, useEffect } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { Reading } from "../../parts/reading.js";
import { draft } from "../../state/project.js";
import { t } from "../../texts/text.js";
import { duplicate, moveChosen, removeChosen } from "./commands.js";
import { addEmptyMacro, macro, startFromRobot } from "../../state/shown-macro.js";
import { Inspector } from "./inspector.js";
import { MacroList } from "./macro-list.js";
import { pause, seek, time, togglePlay } from "../../state/macro-preview.js";
import { StageCard } from "./stage-card.js";
import { Timeline } from "./timeline.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

const STEP = 0.01; // seconds

/** @param {Tools} tools */
export function MacrosScreen(tools) {
  useEffect(() => {
    startFromRobot();
    return pause;
  }, []);
  useKeys({
    " ": togglePlay,
    Home: () => seek(0),
    ",": () => seek(time.value - STEP),
    ".": () => seek(time.value + STEP),
    "Control+d": duplicate,
    Delete: removeChosen,
    Backspace: removeChosen,
    "Alt+ArrowLeft": () => moveChosen(-1),
    "Alt+ArrowRight": () => moveChosen(1),
  });
  if (draft.value === null) return html`<${Reading} link=${tools.link} icon="macros" />`;
  if (draft.value.macros.length === 0) return html`<${NoMacros} />`;
  return html`<h1 class="sr">${t("screen.macros")}</h1>
    <div class="macs">
      <${MacroList} />
      <${StageCard} ...${tools} />
      <${Inspector} key=${macro.value?.macro_id} />
      <${Timeline} />
    </div>`;
}

const NoMacros = () => html`<div class="card empty">
  <${Icon} name="macros" />
  <h1>${t("macros.none")}</h1>
  <p>${t("macros.none_detail")}</p>
  <div class="row wrap">
    <button class="btn pri" onClick=${addEmptyMacro}><${Icon} name="plus" />${t("macros.new")}</button>
    <a class="btn" href="#actions"><${Icon} name="actions" />${t("macros.make_actions")}</a>
  </div>
</div>`;
