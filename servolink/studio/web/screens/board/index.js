// Board: which boards are here, what is known of this one, what is wrong with it, and who else uses it.

import { html } from "../../html.js";
import { t } from "../../texts/text.js";
import { About } from "./about.js";
import { BoardList } from "./board-list.js";
import { Doctor } from "./doctor.js";
import { LinkCard } from "./links.js";
import { People } from "./people.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function BoardScreen({ link }) {
  return html`<h1 class="sr">${t("screen.board")}</h1>
    <div class="conn">
      <div><${BoardList} link=${link} /><${LinkCard} link=${link} /></div>
      <div><${Doctor} link=${link} /><${About} /><${People} /></div>
    </div>`;
}
