// Findings of the doctor about the board: observation, meaning and remedy of each.

import { html } from "../../html.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { isLive, mayEdit } from "../../state/robot.js";
import { said } from "../../texts/said.js";
import { number, t, texts } from "../../texts/text.js";
import { useAnswer } from "./asking.js";
import { Command } from "./command.js";

/** @typedef {{ check: string, observation: string, meaning: string, remedy: string }} Finding */
/** @typedef {{ noise: number, responses: number, programs: { unanswered: number }[] }} Status */
/** @typedef {import("../../link/link.js").Link} Link */

const A_COMMAND = /^(?:.*?(?:: |：))?((?:sudo|servolink|python\S*|pip|kill|echo|usbipd|newgrp|docker)\s.*)$/;

/** @param {{ link: Link }} props */
export function Doctor({ link }) {
  const report = useAnswer(link, "studio.doctor", () => ({ is_connected: isLive.value }));
  const line = useAnswer(link, "status", () => ({}));
  const again = () => Promise.all([report.ask(), line.ask()]);
  const findings = /** @type {{ findings: Finding[] } | null} */ (report.answer)?.findings ?? null;
  const status = /** @type {Status | null} */ (line.answer);
  const all = [...(findings ?? []), ...ofLine(status), ...ofConnection()];
  if (!mayEdit.value) return null;
  return html`<section class="card">
    <header><h2>${t("board.doctor")}</h2>
      <button class="btn s" disabled=${report.isAsking} onClick=${again}>${t("board.examine")}</button>
    </header>
    ${findings === null && html`<p class="pad0 mut">${report.error ? safeText(report.error) : t("board.not_examined")}</p>`}
    ${findings !== null && all.length === 0 && html`<div class="pad0"><${Note} kind="ok" title=${t("board.nothing_wrong")} detail=${t("board.nothing_wrong_detail")} /></div>`}
    ${all.map((finding, at) => html`<${One} key=${finding.check} number=${at + 1} finding=${finding} />`)}
    ${status && html`<${Line} status=${status} />`}
  </section>`;
}

/** @param {{ number: number, finding: Finding }} props */
export function One({ number, finding: { check, observation, meaning, remedy } }) {
  const known = texts.value.findings[check];
  return html`<div class="finding">
    <div class="row"><span class="chip warn num">${number}</span><b>${known?.title ?? safeText(check)}</b></div>
    <dl>
      <dt>${t("board.seen")}</dt><dd>${safeText(said(observation))}</dd>
      <dt>${t("board.means")}</dt><dd>${known?.meaning ?? safeText(said(meaning))}</dd>
      <dt>${t("board.do")}</dt><dd class="cmds">${said(remedy)
        .split("\n")
        .map((step) => html`<${Step} text=${step} />`)}</dd>
    </dl>
  </div>`;
}

/** @param {{ text: string }} props */
function Step({ text }) {
  const command = A_COMMAND.exec(text)?.[1];
  if (command === undefined) return html`<p>${safeText(text)}</p>`;
  const before = text.slice(0, text.length - command.length);
  return html`${before && html`<p>${safeText(before)}</p>`}<${Command} text=${command} />`;
}

/** @param {{ status: Status }} props */
const Line = ({ status }) => html`<dl class="kv pad0">
  <dt>${t("board.responses")}</dt><dd>${number(status.responses)}</dd>
  <dt>${t("board.noise")}</dt><dd>${number(status.noise)}</dd>
  <dt>${t("board.unanswered")}</dt><dd>${number(unanswered(status))}</dd>
</dl>`;

/** @param {Status} status */
const unanswered = (status) => status.programs.reduce((sum, program) => sum + program.unanswered, 0);

/**
 * @param {Status | null} status
 * @returns {Finding[]}
 */
function ofLine(status) {
  if (status === null || (status.noise === 0 && unanswered(status) === 0)) return [];
  const values = { noise: status.noise, unanswered: unanswered(status) };
  return [
    {
      check: t("board.line"),
      observation: t("board.line_seen", values),
      meaning: t("board.line_means"),
      remedy: t("board.line_do"),
    },
  ];
}

/** @returns {Finding[]} */
const ofConnection = () =>
  isLive.value
    ? []
    : [
        {
          check: t("board.gone"),
          observation: t("board.gone_seen"),
          meaning: t("board.gone_means"),
          remedy: t("board.gone_do"),
        },
      ];
