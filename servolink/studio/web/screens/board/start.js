// Page of a studio without a board: a virtual robot, the robots here, or a board made of a Pico.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { isInPage } from "../../state/connecting.js";
import { isLocalEditor } from "../../state/robot.js";
import { t } from "../../texts/text.js";
import { PicoCard } from "./pico.js";
import { RobotList, useActions, VIRTUAL } from "./robots.js";

/** @param {{ link: import("../../link/link.js").Link }} props */
export function StartScreen({ link }) {
  const { actions, problem } = useActions(link, async () => {});
  if (!isLocalEditor.value)
    return html`<div class="empty"><${Icon} name="board" /><h1>${t("start.none")}</h1><p>${t("start.wait")}</p></div>`;
  return html`<div class="start">
    <header><h1>${t("start.title")}</h1><p class="mut">${t("start.nothing_moves")}</p></header>
    <div class="conn">
      <div><${RobotList} link=${link} /></div>
      <div>
        <section class="card"><header><h2>${t("start.virtual")}</h2></header>
          <div class="pad0 stack"><p>${t("start.virtual_detail")}</p>
            ${problem && html`<${Note} kind="bad" urgent title=${t("robots.failed")} detail=${safeText(problem)} />`}
            <div class="row"><button class="btn pri" disabled=${actions.busy !== ""} onClick=${() => actions.use(VIRTUAL)}><${Icon} name="chip" />${t("start.virtual_begin")}</button></div>
          </div>
        </section>
        ${!isInPage && html`<${PicoCard} link=${link} />`}
      </div>
    </div>
  </div>`;
}
