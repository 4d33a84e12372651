// Run of a stored action or macro on several boards at the same moment: choice, question, and what came of it.

import { html, useEffect, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { groups, pick, picked, pickNone, tiles } from "../../state/fleet.js";
import { said } from "../../texts/said.js";
import { list, t } from "../../texts/text.js";

/** @typedef {import("../../link/link.js").Link} Link */
/** @typedef {{ type: "action" | "macro", id: number | string }} Run */
/** @typedef {Run & { boards: number }} Runnable */
/** @typedef {{ started: string[], held_back: string[], failed: Record<string, string>, may_have_started: string[], idle: string[] }} Ran */
/** @typedef {{ run: Run, boards: string[] }} Asked */
/** What was asked for, with the outcome or the error. @typedef {Asked & { ran: Ran | null, error: string }} Outcome */

const MOST_NAMED = 12; // boards named in one sentence

/** @param {{ link: Link, shown: import("../../state/fleet.js").Tile[] }} props */
export function RunCard({ link, shown }) {
  const boards = [...tiles.value.values()]
    .filter((tile) => tile.may_run && picked.value.has(tile.name))
    .map(({ name }) => name);
  const runnable = useRunnable(link, boards);
  const [wanted, setWanted] = useState(""),
    [asked, setAsked] = useState(/** @type {Asked | null} */ (null)),
    [isBusy, setBusy] = useState(false),
    [outcome, setOutcome] = useState(/** @type {Outcome | null} */ (null));
  const chosen = runnable.find((each) => keyOf(each) === wanted) ?? runnable[0];
  /**
   * @param {Asked} asking
   * @param {boolean} anyway
   */
  const start = async (asking, anyway) => {
    setAsked(null);
    setOutcome(null);
    setBusy(true);
    const { type, id } = asking.run;
    try {
      const ran = await link.call("studio.fleet.run", { run: { type, id }, boards: asking.boards, anyway });
      setOutcome({ ...asking, ran, error: "" });
    } catch (failure) {
      setOutcome({ ...asking, ran: null, error: failure instanceof Error ? failure.message : String(failure) });
    }
    setBusy(false);
  };
  const canRun = shown.filter((tile) => tile.may_run).map(({ name }) => name);
  return html`<section class="card" aria-labelledby="run-title">
    <header class="wrap"><h2 id="run-title">${t("fleet.run_title")}</h2><span class="chip num">${t("fleet.picked", { count: boards.length })}</span></header>
    <div class="pad0 stack">
      <div class="row wrap" role="group" aria-label=${t("fleet.choose")}>
        ${canRun.length > 0 && html`<button class="btn s" onClick=${() => pick(canRun)}>${t("fleet.shown", { count: canRun.length })}</button>`}
        ${Object.entries(groups.value).map(([group, names]) => html`<button key=${group} class="btn s" onClick=${() => pick(names)}>${safeText(group)} (${names.length})</button>`)}
        ${picked.value.size > 0 && html`<button class="btn s ghost" onClick=${pickNone}>${t("fleet.pick_none")}</button>`}
      </div>
      ${boards.length === 0 && html`<p class="mut">${t(canRun.length > 0 ? "fleet.pick_first" : "fleet.none_may")}</p>`}
      ${boards.length > 0 && !chosen && html`<p class="mut">${t("fleet.nothing_stored")}</p>`}
      ${
        chosen &&
        html`<div class="row wrap">
        <label class="field grow"><span>${t("fleet.what")}</span>
          <select class="inp" onChange=${(/** @type {Event} */ event) => setWanted(/** @type {HTMLSelectElement} */ (event.currentTarget).value)}>
            ${runnable.map((each) => html`<option key=${keyOf(each)} value=${keyOf(each)} selected=${each === chosen}>${nameOf(each)} (${t(`fleet.${each.type}`)}, ${each.boards}/${boards.length})</option>`)}
          </select></label>
        <button class="btn pri end" disabled=${isBusy} onClick=${() => setAsked({ run: chosen, boards })}><${Icon} name="play" />${isBusy ? t("robots.busy") : t("fleet.run", { count: boards.length })}</button>
      </div>`
      }
      ${asked && html`<${Question} ...${asked} onStart=${() => start(asked, false)} onCancel=${() => setAsked(null)} />`}
      ${outcome && html`<${Result} outcome=${outcome} onAnyway=${() => start(outcome, true)} />`}
    </div>
  </section>`;
}

/**
 * Return what the boards have to run, those of most boards first.
 * @param {Link} link
 * @param {string[]} boards
 */
function useRunnable(link, boards) {
  const [runnable, setRunnable] = useState(/** @type {Runnable[]} */ ([]));
  useEffect(() => {
    let isLatest = true;
    if (boards.length === 0) setRunnable([]);
    else
      link.call("studio.fleet.runnable", { boards }).then(
        (answer) => isLatest && setRunnable(answer.runnable),
        () => isLatest && setRunnable([]),
      );
    return () => void (isLatest = false);
  }, [boards.join()]);
  return runnable;
}

/**
 * Question before a start; not a dialog, which would cover STOP on a tablet.
 * @param {{ run: Run, boards: string[], onStart: () => void, onCancel: () => void }} props
 */
const Question = ({
  run,
  boards,
  onStart,
  onCancel,
}) => html`<${Note} kind="info" urgent title=${t("fleet.ask", { name: nameOf(run), count: boards.length })} detail=${`${named(boards)}\n${t("fleet.ask_detail")}`}>
  <button class="btn" onClick=${onCancel}>${t("fleet.cancel")}</button>
  <button class="btn pri" onClick=${onStart}><${Icon} name="play" />${t("fleet.start", { count: boards.length })}</button>
</${Note}>`;

/** @param {{ outcome: Outcome, onAnyway: () => void }} props */
function Result({ outcome: { run, ran, error }, onAnyway }) {
  if (ran === null) return html`<${Note} kind="bad" urgent title=${safeText(error)} />`;
  const failed = Object.values(ran.failed),
    name = nameOf(run);
  return html`
    ${ran.started.length > 0 && html`<${Note} kind="ok" urgent title=${t("fleet.started", { name, count: ran.started.length })} detail=${named(ran.started)} />`}
    ${ran.idle.length > 0 && html`<${Note} kind="warn" urgent title=${t("fleet.idle")} detail=${named(ran.idle)} />`}
    ${ran.may_have_started.length > 0 && html`<${Note} kind="bad" urgent title=${t("fleet.may_have_started")} detail=${named(ran.may_have_started)} />`}
    ${
      failed.length > 0 &&
      html`<${Note} kind="warn" urgent title=${t(ran.started.length > 0 ? "fleet.some_failed" : "fleet.not_started")} detail=${failed.slice(0, MOST_NAMED).map(said).map(safeText).join("\n")}>
      ${ran.held_back.length > 0 && html`<button class="btn" onClick=${onAnyway}>${t("fleet.anyway", { count: ran.held_back.length })}</button>`}
    </${Note}>`
    }`;
}

/** @param {Run} run */
const keyOf = ({ type, id }) => JSON.stringify([type, id]);

/** @param {Run} run */
const nameOf = ({ id }) => safeText(String(id));

/** @param {string[]} boards */
function named(boards) {
  const shown = list(boards.slice(0, MOST_NAMED));
  return boards.length > MOST_NAMED ? t("fleet.and_more", { boards: shown, count: boards.length - MOST_NAMED }) : shown;
}
