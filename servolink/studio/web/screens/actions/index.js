// Actions: poses as pictures, the figure as their editor, and every servo with its target and its time.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { Reading } from "../../parts/reading.js";
import { draft } from "../../state/project.js";
import { t } from "../../texts/text.js";
import { addTaken, duplicate, mirrorAction } from "./commands.js";
import { addAction, toggleGhost } from "../../state/shown-action.js";
import { PoseList } from "./pose-list.js";
import { StageCard } from "./stage-card.js";
import { StepsCard } from "./steps-card.js";
import { Toolbar } from "./toolbar.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function ActionsScreen(tools) {
  useKeys({ m: mirrorAction, g: toggleGhost, "Control+d": duplicate });
  if (draft.value === null) return html`<${Reading} link=${tools.link} icon="actions" />`;
  if (draft.value.actions.length === 0) return html`<${NoActions} />`;
  return html`<h1 class="sr">${t("screen.actions")}</h1>
    <div class="acts">
      <${PoseList} />
      <div class="mid"><${StageCard} ...${tools} /><${Toolbar} /></div>
      <${StepsCard} />
    </div>`;
}

const NoActions = () => html`<div class="card empty">
  <${Icon} name="actions" />
  <h1>${t("actions.none")}</h1>
  <p>${t("actions.none_detail")}</p>
  <div class="row wrap">
    <button class="btn pri" onClick=${addTaken}><${Icon} name="camera" />${t("actions.take_first")}</button>
    <button class="btn" onClick=${() => addAction("actions.did_add", t("actions.new_name", { number: 1 }), [])}>
      <${Icon} name="plus" />${t("actions.start_empty")}
    </button>
  </div>
</div>`;
