// Notices above every screen: the board is gone, somebody else moves the robot, or this page may only watch.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { Note } from "../parts/note.js";
import { safeText } from "../parts/safe-text.js";
import { dismissRefusal, endWatching, isTabClosed, offered, refused, watch, watched } from "../state/connecting.js";
import {
  another,
  boardState,
  dismissProblem,
  hasBoard,
  hold,
  isLive,
  isOthers,
  lease,
  linkState,
  mayMove,
  problem,
  welcome,
} from "../state/robot.js";
import { isAllStopped, stoppedCount } from "../state/stopped.js";
import { toast } from "../state/toasts.js";
import { said } from "../texts/said.js";
import { t } from "../texts/text.js";
import { ask } from "./control.js";

/** @typedef {import("./app.js").Tools} Tools */

/** @param {Tools} tools */
export function Notices(tools) {
  const note = present();
  const canAsk = note?.key === "note.others",
    canLeave = note?.key === "note.unshared" && isLocal(),
    canEnd = watched !== null && note?.key === "note.watching",
    canTakeOver = note?.key === "note.tab_closed";
  return html`${
    note &&
    html`<div class="veil"><${Note} ...${note}>
    ${canAsk && html`<button class="btn" onClick=${() => ask(tools)}>${t("lease.ask_for")}</button>`}
    ${canLeave && html`<button class="btn" onClick=${() => tools.link.leave()}>${t("robots.choose_other")}</button>`}
    ${canEnd && html`<button class="btn" onClick=${() => endWatching()}>${t("tabs.end")}</button>`}
    ${canTakeOver && html`<button class="btn" onClick=${() => endWatching(watched?.url)}>${t("lease.take_over")}</button>`}
  </${Note}></div>`
  }<${StoppedNote} ...${tools} /><${ProblemNote} /><${RefusedNote} /><${TabNote} />`;
}

/** @param {Tools} tools */
function StoppedNote({ motion }) {
  if (!isLive.value || stoppedCount.value === 0) return null;
  const title = isAllStopped.value ? t("note.stopped") : t("note.some_stopped", { count: stoppedCount.value });
  const start = () => motion.startAll().catch((error) => toast({ kind: "bad", title: error.message }));
  return html`<div class="veil"><${Note} kind="warn" urgent title=${title} detail=${t("note.stopped_detail")}>
    ${mayMove.value && !isOthers.value && html`<button class="btn" onClick=${start}>${t("stop.start")}</button>`}
  </${Note}></div>`;
}

function ProblemNote() {
  if (problem.value === "") return null;
  return html`<div class="veil"><${Note} kind="warn" urgent title=${t("note.problem")} detail=${safeText(said(problem.value))}>
    <button class="btn ic ghost" aria-label=${t("app.close")} onClick=${dismissProblem}><${Icon} name="close" /></button>
  </${Note}></div>`;
}

function RefusedNote() {
  if (refused.value === "") return null;
  return html`<div class="veil"><${Note} kind="warn" urgent title=${t("note.refused_board")} detail=${safeText(said(refused.value))}>
    <button class="btn ic ghost" aria-label=${t("app.close")} onClick=${dismissRefusal}><${Icon} name="close" /></button>
  </${Note}></div>`;
}

/** The robot of another tab, which this tab may watch. */
function TabNote() {
  const robot = offered.value;
  if (robot === null) return null;
  return html`<div class="veil"><${Note} kind="info" title=${t("tabs.offered", { name: safeText(robot.name) })} detail=${t("tabs.offered_detail")}>
    <button class="btn" onClick=${() => watch(robot)}>${t("tabs.watch")}</button>
  </${Note}></div>`;
}

function present() {
  if (linkState.value === "refused")
    return { kind: "bad", urgent: true, ...both(isLocal() ? "note.refused" : "note.revoked") };
  if (isTabClosed.value) return { kind: "bad", urgent: true, ...both("note.tab_closed") };
  if (linkState.value === "lost") return { kind: "bad", urgent: true, ...both("note.studio_lost") };
  if (linkState.value === "unshared") return { kind: "bad", urgent: true, ...both("note.unshared") };
  if (linkState.value === "connecting" || !hasBoard.value) return null;
  if (boardState.value !== "connected" && another.value !== "") {
    const name = safeText(welcome.value?.name ?? "");
    return { kind: "bad", urgent: true, ...both("note.another", { name, another: safeText(another.value) }) };
  }
  if (boardState.value !== "connected") return { kind: "bad", urgent: true, ...both("note.board_lost") };
  if (hold.value !== null && hold.value.session !== welcome.value?.session) {
    const { who, reason } = hold.value;
    return { kind: "info", ...both("note.held", { who: safeText(said(who)), reason: safeText(said(reason)) }) };
  }
  if (!mayMove.value) return { kind: "info", ...both("note.watching") };
  if (isOthers.value) return { kind: "info", ...both("note.others", { who: safeText(said(lease.value?.who ?? "")) }) };
  return null;
}

/** Return whether the page was opened on the machine of the studio, so that its terminal is at hand. */
const isLocal = () => ["127.0.0.1", "localhost", "[::1]"].includes(location.hostname);

/**
 * @param {"note.refused" | "note.revoked" | "note.studio_lost" | "note.tab_closed" | "note.unshared" | "note.board_lost" | "note.another" | "note.held" | "note.watching" | "note.others"} key
 * @param {Record<string, string>} [values]
 */
const both = (key, values = {}) => ({ key, title: t(key, values), detail: t(`${key}_detail`, values) });
