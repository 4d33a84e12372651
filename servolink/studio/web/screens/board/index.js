// Board: list of robots, profile, figure, findings of the doctor, and other programs.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { safeText } from "../../parts/safe-text.js";
import { figure, ownFigure, saveFigure } from "../../state/figure.js";
import { isInPage } from "../../state/connecting.js";
import { beginFit, fit } from "../../state/fitting.js";
import { isLive, isLocalEditor, lease, programs, servoIds, welcome } from "../../state/robot.js";
import { renamePage, who } from "../../state/settings.js";
import { toast } from "../../state/toasts.js";
import { said } from "../../texts/said.js";
import { t } from "../../texts/text.js";
import { Doctor } from "./doctor.js";
import { figureName, FitCard } from "./fit.js";
import { LineTestCard } from "./line-test.js";
import { LinkCard } from "./links.js";
import { RawAnglesCard } from "./raw-angles.js";
import { RobotList } from "./robots.js";
import { SettingsCard } from "./settings.js";

/** @typedef {import("../../state/robot.js").Program} Program */
/** @typedef {import("../../texts/text.js").Key} Key */
/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function BoardScreen({ link, motion }) {
  if (fit.value !== null) return html`<${FitCard} link=${link} motion=${motion} />`;
  return html`<h1 class="sr">${t("screen.board")}</h1>
    <div class="conn">
      <div><${RobotList} link=${link} /><${FigureCard} link=${link} /><${SettingsCard} link=${link} />${!isInPage && html`<${LinkCard} link=${link} />`}</div>
      <div><${LineTestCard} link=${link} /><${About} /><${RawAnglesCard} link=${link} /><${People} link=${link} /><${Doctor} link=${link} /></div>
    </div>`;
}

// Figure of the robot, and buttons for changes.

/** @param {{ link: import("../../link/link.js").Link }} props */
function FigureCard({ link }) {
  const known = figure.value,
    isOwn = ownFigure.value !== null;
  const useTemplate = () => {
    const before = ownFigure.value,
      action = { label: t("edit.undo"), run: () => save(link, before) };
    save(link, null).then(() => toast({ kind: "ok", title: t("figure.use_template"), action }));
  };
  return html`<section class="card">
    <header><h2>${t("figure.title")}</h2>${known && html`<span class="chip">${figureName(known)}</span>`}</header>
    <div class="pad0 stack">
      <p class="mut">${t(known === null ? "figure.none" : isOwn ? "figure.is_own" : "figure.is_template")}</p>
      ${
        isLocalEditor.value &&
        html`<div class="row wrap">
        <button class="btn s" disabled=${!isLive.value} onClick=${beginFit}><${Icon} name="live" />${t("figure.fit")}</button>
        ${isOwn && html`<button class="btn s" onClick=${useTemplate}>${t("figure.use_template")}</button>`}
      </div>`
      }
    </div>
  </section>`;
}

/**
 * @param {import("../../link/link.js").Link} link
 * @param {import("../../state/figure.js").FigureData | null} data
 */
const save = (link, data) =>
  saveFigure(link, data).catch((error) => toast({ kind: "bad", title: safeText(error.message) }));

// Profile of the board, which `servolink doctor --learn` writes. Nothing is changed here.

/** Settings with a text for people, in this order; other settings follow with their names in the file. @type {Record<string, Key>} */
const TITLES = {
  byte_order: "board.byte_order",
  caption_encoding: "board.caption_encoding",
  on_duplicate: "board.on_duplicate",
  interval_unit: "board.interval_unit",
  speed_cap: "board.speed_cap",
};

function About() {
  const { name = "", profile } = welcome.value ?? {},
    { settings = {}, limits = {} } = profile ?? {};
  const known = Object.entries({ ...settings, ...limits }).filter(([, value]) => !isNothing(value));
  const order = Object.keys(TITLES),
    place = (/** @type {string} */ key) => (order.indexOf(key) + order.length + 1) % (order.length + 1);
  known.sort(([one], [other]) => place(one) - place(other));
  return html`<section class="card">
    <header><h2>${t("board.about")}</h2></header>
    <div class="pad0">
      <dl class="kv">
        <dt>${t("board.name")}</dt><dd>${safeText(name)}</dd>
        <dt>${t("board.servos")}</dt><dd>${servoIds.value.length}</dd>
        ${known.map(([key, value]) => html`<dt>${key in TITLES ? t(TITLES[key]) : html`<span class="mono">${safeText(key)}</span>`}</dt><dd>${safeText(textOf(value))}</dd>`)}
      </dl>
      ${known.length === 0 && html`<p class="mut">${t("board.nothing_known")}</p>`}
    </div>
  </section>`;
}

/** @param {unknown} value */
const isNothing = (value) =>
  value === null || (typeof value === "object" && Object.keys(/** @type {object} */ (value)).length === 0);

/** @param {unknown} value */
const textOf = (value) => (typeof value === "object" ? JSON.stringify(value) : String(value));

// Programs on the board, and the program with control.

/** @param {{ link: import("../../link/link.js").Link }} props */
function People({ link }) {
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
    name = safeText(said(program.who));
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
