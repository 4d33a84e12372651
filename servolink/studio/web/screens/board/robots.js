// List of the robots here: connects, changes the robot on all pages, and shares a board with other programs.

import { html, useEffect, useState } from "../../html.js";
import { LinkLost } from "../../link/link.js";
import { AskButton } from "../../parts/ask-button.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { isInPage } from "../../state/connecting.js";
import { hasBoard, isLive, isLocalEditor, noteShared, welcome } from "../../state/robot.js";
import { said } from "../../texts/said.js";
import { t } from "../../texts/text.js";
import { useAnswer } from "./asking.js";
import { Command } from "./command.js";
import { One } from "./doctor.js";
import { OwnRobot } from "./own-robot.js";

/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {import("./doctor.js").Finding} Finding */
/** @typedef {{ url: string, shares: string, name: string, product: string, problem: string, findings: Finding[], is_ours: boolean, is_kept: boolean }} Found */
/** Board of the fleet on another machine; without an address it is not reached from here. @typedef {{ name: string, host: string, url: string }} Far */
/** What a person does with a board; `busy` is the address of the board that is being opened or closed, empty for none. */
/** @typedef {{ busy: string, use: (url: string) => void, share: (url: string) => void, giveBack: (found: Found) => void }} Actions */

export const VIRTUAL = "virtual://?servos=16";
const SHARED = "share://";

/** @param {{ link: Link }} props */
export function RobotList({ link }) {
  const { answer, error, isAsking, ask } = useAnswer(link, "studio.boards", () => ({}));
  const { actions, problem } = useActions(link, ask);
  const { boards = [], fleet = [] } = /** @type {{ boards?: Found[], fleet?: Far[] } | null} */ (answer) ?? {};
  const others = boards.filter((board) => !board.is_ours);
  useEffect(() => noteShared(boards.some((board) => board.is_kept)), [answer]);
  return html`<section class="card">
    <header><h2>${t("robots.title")}</h2>
      ${isLocalEditor.value && html`<button class="btn s" disabled=${isAsking || answer === null} onClick=${ask}><${Icon} name="search" />${t("robots.look_again")}</button>`}
    </header>
    ${problem && html`<div class="pad0"><${Note} kind="bad" urgent title=${t("robots.failed")} detail=${safeText(problem)} /></div>`}
    <ul>
      ${hasBoard.value && html`<${Present} found=${boards.find((board) => board.is_ours)} actions=${actions} />`}
      ${others.map((board) => html`<${Other} key=${board.url} board=${board} actions=${actions} />`)}
      ${fleet.map((board) => html`<${OfFleet} key=${`fleet ${board.name}`} board=${board} actions=${actions} />`)}
    </ul>
    ${answer !== null && others.length + fleet.length === 0 && html`<p class="pad0 mut">${t(hasBoard.value ? "robots.no_others" : "robots.none")}</p>`}
    ${answer === null && html`<p class="pad0 mut">${error ? t("robots.not_here") : t("robots.searching")}</p>`}
    ${answer !== null && html`<${More} actions=${actions} />`}
  </section>`;
}

/**
 * Return the actions on boards, and the problem of the latest one; `ask` lists the boards again.
 * @param {Link} link
 * @param {() => Promise<void>} ask
 * @returns {{ actions: Actions, problem: string }}
 */
export function useActions(link, ask) {
  const [busy, setBusy] = useState("");
  const [problem, setProblem] = useState("");
  /**
   * @param {string} url
   * @param {string} method
   * @param {object} params
   */
  const act = async (url, method, params) => {
    setBusy(url);
    setProblem("");
    try {
      await link.call(method, params);
      await ask();
    } catch (failure) {
      if (failure instanceof LinkLost) return; // the page goes on to the new board
      setProblem(failure instanceof Error ? failure.message : String(failure));
    }
    setBusy("");
  };
  const actions = {
    busy,
    use: (/** @type {string} */ url) => act(url || SHARED, "studio.use", { url }),
    share: (/** @type {string} */ url) => act(url, "studio.share", { url }),
    giveBack: (/** @type {Found} */ { url }) => act(url, "studio.give_back", { name: url.slice(SHARED.length) }),
  };
  return { actions, problem };
}

/** @param {{ found: Found | undefined, actions: Actions }} props */
function Present({ found, actions }) {
  const { name = "", url = "" } = welcome.value ?? {};
  return html`<li class="bd2 on">
    <span class="ico"><${Icon} name=${iconOf(url)} /></span>
    <div class="grow"><b>${safeText(name)}</b>
      ${isLive.value ? html`<span class="chip ok">${t("board.connected")}</span>` : html`<span class="chip bad">${t("board.is_lost")}</span>`}
      <small class="num mono">${safeText(url)}</small></div>
    ${found?.is_kept && html`<${GiveBack} found=${found} actions=${actions} title="robots.disconnect" />`}
    ${found && !found.is_kept && html`<button class="btn s" disabled=${actions.busy !== ""} onClick=${() => actions.use("")}>${t("robots.disconnect")}</button>`}
  </li>`;
}

/**
 * Button to end the sharing of a board, with a question before the loss of a virtual board.
 * @param {{ found: Found, actions: Actions, title: import("../../texts/text.js").Key, label?: string }} props
 */
function GiveBack({ found, actions, title, label }) {
  const name = safeText(found.name),
    yes = t(title);
  const question = { title: `${yes}: ${name}`, detail: t("robots.virtual_goes", { name }), yes };
  return html`<${AskButton} label=${label && `${yes}: ${label}`} disabled=${actions.busy !== ""} question=${found.shares.startsWith("virtual:") ? question : null} onYes=${() => actions.giveBack(found)}>${yes}</${AskButton}>`;
}

/** @param {{ board: Found, actions: Actions }} props */
function Other({ board, actions }) {
  const { url, name, product, problem, findings, is_kept: isKept } = board;
  const isShared = url.startsWith(SHARED);
  const title = safeText(name || product) || t("board.some_board");
  const button = (/** @type {import("../../texts/text.js").Key} */ key, /** @type {() => void} */ run, kind = "") =>
    html`<button class="btn s ${kind}" disabled=${actions.busy !== ""} aria-label=${`${t(key)}: ${title}`} onClick=${run}>${t(key)}</button>`;
  return html`<li class="bd2">
    <span class="ico"><${Icon} name=${iconOf(url)} /></span>
    <div class="grow">
      <b>${title}</b>
      ${isShared && html`<span class="chip">${t(isKept ? "robots.kept" : "robots.shared")}</span>`}
      ${actions.busy === url && html`<span class="chip acc" role="status">${t("robots.busy")}</span>`}
      <small class="num mono">${safeText(board.shares || url)}</small>
    </div>
    ${
      !problem &&
      html`<div class="row wrap">
      ${isKept && html`<${GiveBack} found=${board} actions=${actions} title="robots.give_back" label=${title} />`}
      ${!isShared && !isInPage && button("robots.share", () => actions.share(url))}
      ${button(isShared ? "robots.use" : "robots.connect", () => actions.use(url), "pri")}
    </div>`
    }
    ${problem && html`<div class="whole"><${Note} kind="warn" title=${safeText(said(problem))} />${findings.map((finding, at) => html`<${One} key=${finding.check} number=${at + 1} finding=${finding} />`)}</div>`}
  </li>`;
}

/** @param {{ board: Far, actions: Actions }} props */
function OfFleet({ board: { name, host, url }, actions }) {
  const from = safeText(host);
  return html`<li class="bd2">
    <span class="ico"><${Icon} name="fleet" /></span>
    <div class="grow"><b>${name}</b><span class="chip">${t("robots.in_fleet")}</span>
      ${actions.busy === url && url && html`<span class="chip acc" role="status">${t("robots.busy")}</span>`}
      <small class="num mono">${safeText(url) || from}</small></div>
    ${url && html`<button class="btn s pri" disabled=${actions.busy !== ""} aria-label=${`${t("robots.connect")}: ${name}`} onClick=${() => actions.use(url)}>${t("robots.connect")}</button>`}
    ${!url && html`<details class="whole"><summary>${t("robots.how")}</summary><p class="mut">${t("robots.how_detail", { host: from })}</p><${Command} text=${`servolink share --name ${name} --tcp "*:9000"`} /></details>`}
  </li>`;
}

/** @param {{ actions: Actions }} props */
function More({ actions }) {
  return html`<div class="pad0 stack">
    ${hasBoard.value && html`<div class="row"><button class="btn s" disabled=${actions.busy !== ""} onClick=${() => actions.use(VIRTUAL)}><${Icon} name="chip" />${t("robots.new_virtual")}</button></div>`}
    ${isInPage ? html`<${OwnRobot} actions=${actions} />` : html`<${Address} actions=${actions} />`}
  </div>`;
}

/** @param {{ actions: Actions }} props */
function Address({ actions }) {
  const [address, setAddress] = useState("");
  const connect = (/** @type {Event} */ event) => {
    event.preventDefault();
    if (address.trim()) actions.use(withScheme(address.trim()));
  };
  return html`<form class="row" onSubmit=${connect}>
      <label class="field grow"><span>${t("robots.address")}</span>
        <input class="inp" maxlength="500" spellcheck="false" autocomplete="off" placeholder="tcp://192.168.1.20:9000" value=${address}
          onInput=${(/** @type {Event} */ event) => setAddress(/** @type {HTMLInputElement} */ (event.currentTarget).value)} /></label>
      <button class="btn end" disabled=${actions.busy !== "" || address.trim() === ""}>${t("robots.connect")}</button>
    </form>`;
}

/** Return an address with its scheme, where only host and port are given. @param {string} address */
const withScheme = (address) => (/^[\w.-]+:\d+$/.test(address) ? `tcp://${address}` : address);

/** @param {string} url */
function iconOf(url) {
  const scheme = url.split(":")[0];
  return { virtual: "chip", tcp: "wifi", share: "hand" }[scheme] ?? "usb";
}
