// The boards that are here, and how to begin with another one.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { isLive, welcome } from "../../state/robot.js";
import { t } from "../../texts/text.js";
import { useAnswer } from "./asking.js";
import { Command } from "./command.js";

/** @typedef {{ url: string, product: string, problem: string, is_ours: boolean }} Found */
/** @typedef {import("../../link/link.js").Link} Link */

const PLAIN = /^[\w:/.@?=&+-]+$/;

/** @param {{ link: Link }} props */
export function BoardList({ link }) {
  const { answer, isAsking, ask } = useAnswer(link, "studio.boards", () => ({}));
  const boards = /** @type {{ boards: Found[] } | null} */ (answer)?.boards ?? [];
  const others = boards.filter((board) => !board.is_ours);
  return html`<section class="card">
    <header><h2>${t("board.boards")}</h2>
      <button class="btn s" disabled=${isAsking} onClick=${ask}><${Icon} name="search" />${t("board.look_again")}</button>
    </header>
    <ul>
      <li class="bd2 on">
        <span class="ico"><${Icon} name=${iconOf(welcome.value?.url ?? "")} /></span>
        <div class="grow"><b>${safeText(welcome.value?.name ?? "")}</b>
          ${isLive.value ? html`<span class="chip ok">${t("board.connected")}</span>` : html`<span class="chip bad">${t("board.is_lost")}</span>`}
          <small class="num mono">${safeText(welcome.value?.url ?? "")}</small></div>
      </li>
      ${others.map((board) => html`<${Other} key=${board.url} board=${board} />`)}
    </ul>
    ${answer !== null && others.length === 0 && html`<p class="pad0 mut">${t("board.no_others")}</p>`}
  </section>`;
}

/** @param {{ board: Found }} props */
function Other({ board: { url, product, problem } }) {
  return html`<li class="bd2">
    <span class="ico"><${Icon} name=${iconOf(url)} /></span>
    <div class="grow">
      <b>${safeText(product) || t("board.some_board")}</b><small class="num mono">${safeText(url)}</small>
      ${problem && html`<${Note} kind="warn" title=${safeText(problem)} />`}
      ${PLAIN.test(url) && html`<${Command} text=${`servolink studio --board ${url}`} />`}
    </div>
  </li>`;
}

/** @param {string} url */
function iconOf(url) {
  const scheme = url.split(":")[0];
  return { virtual: "chip", tcp: "wifi", share: "hand" }[scheme] ?? "usb";
}
