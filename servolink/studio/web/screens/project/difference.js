// One difference between the board and the draft, as a sentence, with pictures of an action before and after.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { safeText } from "../../parts/safe-text.js";
import { nameOf } from "../../state/figure.js";
import { poseOf } from "../../state/records.js";
import { degrees, t } from "../../texts/text.js";
import { actionParts, captionParts, macroParts, summary, tableParts } from "./sentences.js";

/** @typedef {import("../../state/plan.js").Change} Change */
/** @typedef {import("./sentences.js").Part} Part */
/** @typedef {import("../../texts/text.js").Key} Key */

const MOST_PARTS = 12;
const SIGNS = { add: "+", del: "\u2212", chg: "~" };

/** @type {Record<keyof typeof SIGNS, Key>} */
const WORDS = { add: "project.added", del: "project.removed", chg: "project.changed" };

/** @param {{ change: Change }} props */
export function Difference({ change }) {
  const isId = typeof (change.new ?? change.old) !== "object";
  const kind = isId ? "chg" : change.old === null ? "add" : change.new === null ? "del" : "chg";
  const record = change.new ?? change.old;
  return html`<li class="df ${kind}">
    <span class="sym" role="img" aria-label=${t(WORDS[kind])}>${SIGNS[kind]}</span>
    <div class="what">
      <b>${titleOf(change, record)}</b> <span class="mut">${isId ? "" : kindOf(change)}</span>
      <p class="num">${isId || kind === "chg" ? html`<${Parts} parts=${partsOf(change)} />` : summary(record)}</p>
    </div>
    <div class="ba">${record?.steps && html`<${Pictures} change=${change} />`}</div>
  </li>`;
}

/** @param {{ parts: Part[] }} props */
function Parts({ parts }) {
  const shown = parts.slice(0, MOST_PARTS),
    rest = parts.length - shown.length;
  return html`${shown.map(
    ({ text, before, after }, at) =>
      html`${at > 0 && " · "}${text} ${before !== undefined && html`<del>${before}</del>`} ${after !== undefined && html`<ins>${after}</ins>`}`,
  )}
  ${rest > 0 && html` · ${t("project.more", { count: rest })}`}`;
}

/** @param {{ change: Change }} props */
function Pictures({ change }) {
  return html`${change.old && html`<${PosePicture} pose=${poseOf(change.old)} />`}
    ${change.old && change.new && html`<${Icon} name="arrow" />`}
    ${change.new && html`<${PosePicture} pose=${{ ...(change.old ? poseOf(change.old) : {}), ...poseOf(change.new) }} />`}`;
}

/**
 * @param {Change} change
 * @returns {Part[]}
 */
function partsOf({ old, new: now }) {
  if (now?.steps) return actionParts(old, now);
  if (now?.commands) return macroParts(old, now);
  if (now?.buttons) return tableParts(old, now);
  if (now?.servo_id !== undefined) return parameterParts(old, now);
  return [
    {
      before: old === null ? t("buttons.nothing") : String(old),
      after: now === null ? t("buttons.nothing") : String(now),
    },
  ];
}

/**
 * @param {import("../../state/records.js").Parameter} old
 * @param {import("../../state/records.js").Parameter} now
 * @returns {Part[]}
 */
function parameterParts(old, now) {
  const trim = { text: t("project.trim"), before: degrees(old.adjusted_degree), after: degrees(now.adjusted_degree) };
  return [
    ...captionParts(old.servo_caption, now.servo_caption),
    ...(old.adjusted_degree === now.adjusted_degree ? [] : [trim]),
  ];
}

/**
 * @param {Change} change
 * @param {any} record
 */
function titleOf(change, record) {
  if (record?.servo_id !== undefined) return safeText(record.servo_caption) || nameOf(record.servo_id);
  const caption = record?.action_caption ?? record?.macro_caption ?? record?.table_caption;
  return safeText(caption ?? "") || (typeof record === "object" ? t("project.unnamed") : kindOf(change));
}

/** @param {Change} change */
function kindOf({ what, old, new: now }) {
  const record = now ?? old;
  if (record?.action_id !== undefined) return t("project.action", { id: record.action_id });
  if (record?.macro_id !== undefined) return t("project.macro", { id: record.macro_id });
  if (record?.table_id !== undefined) return t("project.table", { id: record.table_id });
  if (record?.servo_id !== undefined) return t("project.servo", { id: record.servo_id });
  return what === "project id"
    ? t("project.id")
    : what.startsWith("active")
      ? t("project.active_table")
      : safeText(what);
}
