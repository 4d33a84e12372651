// Who else uses the board, and who has control.

import { html } from "../../html.js";
import { safeText } from "../../parts/safe-text.js";
import { lease, programs, welcome } from "../../state/robot.js";
import { renamePage, who } from "../../state/settings.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../state/robot.js").Program} Program */

/** @param {{ link: import("../../link/link.js").Link }} props */
export function People({ link }) {
  const rename = (/** @type {string} */ name) => {
    renamePage(name);
    link.rename(name);
  };
  const mine = welcome.value?.session;
  return html`<section class="card">
    <header><h2>${t("board.people")}</h2></header>
    <div class="pad0">
      <ul class="who">
        ${programs.value.map((program) => html`<${Person} key=${program.session} program=${program} isMine=${program.session === mine} />`)}
      </ul>
      <label class="field"><span>${t("board.page_name")}</span>
        <input class="inp" maxlength="60" value=${who.value} placeholder=${t("board.page_name_example")}
          onChange=${(/** @type {Event} */ event) => rename(/** @type {HTMLInputElement} */ (event.currentTarget).value)} />
      </label>
    </div>
  </section>`;
}

/** @param {{ program: Program, isMine: boolean }} props */
function Person({ program, isMine }) {
  const hasLease = lease.value?.session === program.session,
    name = safeText(program.who);
  const state = hasLease
    ? t("board.has_control")
    : program.role === "watch"
      ? t("board.may_watch")
      : t("board.watching");
  return html`<li class="row">
    <span class="dot"></span>
    <span class="grow ell">${isMine ? t("board.this_page", { who: name }) : name}</span>
    <small class="mut">${safeText(program.door)}</small>
    <span class=${hasLease ? "chip acc" : "chip"}>${state}</span>
  </li>`;
}
