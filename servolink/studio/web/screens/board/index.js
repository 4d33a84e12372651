// Board: which boards are here, what is known of this one, what is wrong with it, and who else uses it.

import { html } from "../../html.js";
import { fit } from "../../state/fitting.js";
import { t } from "../../texts/text.js";
import { About } from "./about.js";
import { BoardList } from "./board-list.js";
import { Doctor } from "./doctor.js";
import { FigureCard } from "./figure-card.js";
import { FitCard } from "./fit.js";
import { LinkCard } from "./links.js";
import { People } from "./people.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function BoardScreen({ link, motion }) {
  if (fit.value !== null) return html`<${FitCard} link=${link} motion=${motion} />`;
  return html`<h1 class="sr">${t("screen.board")}</h1>
    <div class="conn">
      <div><${BoardList} link=${link} /><${FigureCard} link=${link} /><${LinkCard} link=${link} /></div>
      <div><${Doctor} link=${link} /><${About} /><${People} link=${link} /></div>
    </div>`;
}
