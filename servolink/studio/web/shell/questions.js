// Questions of programs before a motion. They take no focus, so that no key allows a motion by accident, and cover no STOP.

import { html } from "../html.js";
import { Note } from "../parts/note.js";
import { safeText } from "../parts/safe-text.js";
import { nameOf } from "../state/figure.js";
import { questions } from "../state/questions.js";
import { isLive } from "../state/robot.js";
import { said } from "../texts/said.js";
import { list, number, seconds, t } from "../texts/text.js";

/** @typedef {import("../state/questions.js").Question} Question */

/** @param {import("./app.js").Tools} tools */
export function Questions({ link, motion }) {
  if (!isLive.value) return null;
  /** @param {Question} question @param {boolean} isYes */
  const answer = (question, isYes) => {
    if (isYes) motion.leave(); // the lease of this page would keep the program from moving
    link.tell("question.answer", { number: question.number, is_yes: isYes });
  };
  return html`${questions.value.map((question) => {
    const title = t("ask.title", { who: safeText(said(question.who)) });
    return html`<div class="veil asks" key=${question.number}><${Note} kind="warn" urgent title=${title} detail=${[said(safeText(question.warning ?? "")), asked(question)].join(" ").trim()}>
      <button class="btn" onClick=${() => answer(question, true)}>${t("ask.allow")}</button>
      <button class="btn" onClick=${() => answer(question, false)}>${t("ask.refuse")}</button>
    </${Note}></div>`;
  })}`;
}

/** @param {Question} question */
function asked({ targets, record, caption, seconds: lasts }) {
  const time = seconds(lasts);
  const named = { caption: safeText(caption), time };
  if (record === "action") return t("ask.run_action", named);
  if (record === "macro") return t("ask.run_macro", named);
  const each = Object.entries(targets).map(([id, angle]) =>
    t("ask.target", { servo: nameOf(Number(id)), angle: number(angle, Number.isInteger(angle) ? 0 : 1) }),
  );
  if (each.length === 0) return t("ask.start");
  return t("ask.move", { targets: list(each), time });
}
