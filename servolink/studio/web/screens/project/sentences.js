// Sentences about a change for people: a text, the old value and the new one.

import { safeText } from "../../parts/safe-text.js";
import { nameOf } from "../../state/figure.js";
import { draft, stored } from "../../state/project.js";
import { secondsOf, targetOf } from "../../state/records.js";
import { degrees, seconds, t } from "../../texts/text.js";
import { macroName } from "../buttons/assign.js";

/** @typedef {import("../../state/plan.js").Change} Change */
/** @typedef {import("../../state/records.js").Action} Action */
/** @typedef {import("../../state/records.js").Macro} Macro */
/** @typedef {import("../../state/records.js").Command} Command */
/** @typedef {import("../../state/records.js").Table} Table */
/** @typedef {import("../../state/records.js").Button} Button */
/** @typedef {{ text?: string, before?: string, after?: string }} Part */

/**
 * Return what is changed about an action.
 * @param {Action} before
 * @param {Action} after
 * @returns {Part[]}
 */
export function actionParts(before, after) {
  const old = new Map(before.steps.map((step) => [step.servo_id, step]));
  const now = new Map(after.steps.map((step) => [step.servo_id, step]));
  const parts = captionParts(before.action_caption, after.action_caption);
  for (const id of new Set([...old.keys(), ...now.keys()])) {
    const [one, other] = [old.get(id), now.get(id)];
    if (one?.degree !== other?.degree) {
      parts.push({ text: nameOf(id), before: one && degrees(one.degree), after: other && degrees(other.degree) });
    } else if (one && other && one.interval_ms !== other.interval_ms) {
      parts.push({
        text: nameOf(id),
        before: seconds(one.interval_ms / 1000),
        after: seconds(other.interval_ms / 1000),
      });
    }
  }
  return parts.length > 0 ? parts : [{ text: t("project.order") }];
}

/**
 * Return what is changed about a macro.
 * @param {Macro} before
 * @param {Macro} after
 * @returns {Part[]}
 */
export function macroParts(before, after) {
  const [old, now] = [before.commands.map(commandText), after.commands.map(commandText)];
  const start = old.findIndex((each, at) => each !== now[at]),
    from = start < 0 ? old.length : start;
  let end = 0;
  while (end < Math.min(old.length, now.length) - from && old.at(-1 - end) === now.at(-1 - end)) end++;
  const parts = captionParts(before.macro_caption, after.macro_caption);
  for (const each of old.slice(from, old.length - end)) parts.push({ before: each });
  for (const each of now.slice(from, now.length - end)) parts.push({ after: each });
  const [was, is] = [totalOf(before), totalOf(after)];
  if (was !== is) parts.push({ text: `${seconds(was, 1)} → ${seconds(is, 1)}` });
  return parts.length > 0 ? parts : [{ text: t("project.times") }];
}

/**
 * Return what is changed about a table of buttons.
 * @param {Table} before
 * @param {Table} after
 * @returns {Part[]}
 */
export function tableParts(before, after) {
  const [old, now] = [before, after].map((table) => new Map(table.buttons.map((button) => [button.button_id, button])));
  const parts = captionParts(before.table_caption, after.table_caption);
  for (const id of [...new Set([...old.keys(), ...now.keys()])].sort((a, b) => a - b)) {
    for (const part of buttonParts(old.get(id), now.get(id))) {
      parts.push({ ...part, text: `${t("buttons.button", { id })} ${part.text}` });
    }
  }
  return parts.length > 0 ? parts : [{ text: t("project.order") }];
}

/**
 * @param {Button | undefined} before
 * @param {Button | undefined} after
 * @returns {Part[]}
 */
function buttonParts(before, after) {
  const slots = /** @type {const} */ ([
    ["buttons.press", "button_press_macro"],
    ["buttons.long_press", "button_long_press_macro"],
    ["buttons.up", "button_up_macro"],
  ]);
  const name = (/** @type {number} */ id) => macroName(draft.value, id) || t("buttons.nothing");
  const old = (/** @type {number} */ id) => macroName(stored.value, id) || t("buttons.nothing");
  const parts = /** @type {Part[]} */ (captionParts(before?.button_caption ?? "", after?.button_caption ?? ""));
  for (const [key, slot] of slots) {
    const [was, is] = [before?.[slot] ?? 0, after?.[slot] ?? 0];
    if (was !== is) parts.push({ text: t(key), before: old(was), after: name(is) });
  }
  if ((before?.uninterruptible ?? 0) !== (after?.uninterruptible ?? 0)) parts.push({ text: t("buttons.finish") });
  return parts.map((part) => ({ ...part, text: part.text ?? "" }));
}

/**
 * Return a caption that is changed.
 * @param {string} before
 * @param {string} after
 * @returns {Part[]}
 */
export const captionParts = (before, after) =>
  before === after
    ? []
    : [
        {
          text: t("project.name"),
          before: safeText(before) || t("project.unnamed"),
          after: safeText(after) || t("project.unnamed"),
        },
      ];

/**
 * Return what a record is made of.
 * @param {any} record
 */
export function summary(record) {
  if (record?.steps) return t("project.servos_in", { count: record.steps.length, seconds: seconds(secondsOf(record)) });
  if (record?.commands)
    return t("project.parts_in", { count: record.commands.length, seconds: seconds(totalOf(record), 1) });
  if (record?.adjusted_degree) return `${t("project.trim")} ${degrees(record.adjusted_degree)}`;
  return record?.buttons ? t("project.buttons_in", { count: record.buttons.length }) : "";
}

/** @param {Macro} macro */
const totalOf = (macro) => macro.commands.reduce((sum, command) => sum + command.total_interval_ms, 0) / 1000;

/** @param {Command} command */
function commandText(command) {
  const repeats = command.loop === 1 ? "" : ` × ${command.loop}`,
    ratio = command.ratio_percent === 100 ? "" : ` ${command.ratio_percent} %`;
  if (command.type === "delay")
    return `${t("project.pause", { seconds: seconds((command.delay_ms ?? 0) / 1000) })}${ratio}${repeats}`;
  const id = targetOf(command),
    project = draft.value;
  const action = command.type === "action" ? project?.actions.find((each) => each.action_id === id) : undefined;
  const name =
    command.type === "macro"
      ? macroName(project, id)
      : safeText(action?.action_caption ?? "") || t("project.action", { id });
  return `${name}${ratio}${repeats}`;
}
