// Twin on the screen: the button that tries a record with physics, and the mark of a verdict.

import { html, useEffect } from "../html.js";
import { figure } from "../state/figure.js";
import { draft } from "../state/project.js";
import { nameOfCommand } from "../state/shown-macro.js";
import { endTrial, hasTwin, judge, trial, tryOnTwin, verdictOf } from "../state/twin.js";
import { seconds, t } from "../texts/text.js";
import { Icon } from "./icon.js";
import { safeText } from "./safe-text.js";

/** @typedef {import("../state/twin.js").Type} Type */
/** @typedef {import("../state/twin.js").Fall} Fall */

const PAUSE = 600; // milliseconds after an edit
const ICON_OF = { stands: "check", falls: "close", uncertain: "help" };

/** Button that runs a record on the twin, and the end of the run. @param {{ type: Type, id: number }} props */
export function TryOnTwin({ type, id }) {
  useEffect(() => endTrial, [type, id]);
  const now = trial.value;
  if (figure.value === null || !hasTwin.value) return null;
  if (now === null)
    return html`<button class="btn" title=${t("twin.from")} onClick=${() => tryOnTwin(type, id)}><${Icon} name="play" />${t("twin.try")}</button>`;
  const isRunning = now.state === "running";
  return html`<span class="chip ${isRunning ? "acc" : now.state === "over" && now.fall === null ? "ok" : "bad"}" role="status">${outcome(now)}</span>
    <button class="btn s" onClick=${endTrial}>${t(isRunning ? "twin.cancel" : "twin.close")}</button>`;
}

/** @param {import("../state/twin.js").Trial} now */
function outcome({ type, id, state, seconds: time, fall, error }) {
  if (state === "running") return t("twin.running", { time: seconds(time, 1) });
  if (state === "failed") return t("twin.failed", { reason: safeText(error) });
  return fall === null ? t("twin.stood") : t("twin.fell", { when: whenOf(type, id, fall) });
}

/**
 * Return time and place of a fall.
 * @param {Type} type
 * @param {number} id
 * @param {Fall} fall
 */
export function whenOf(type, id, { seconds: time, command }) {
  const at = seconds(time, 1),
    commands = type === "macro" ? draft.value?.macros.find((one) => one.macro_id === id)?.commands : undefined;
  const found = command === null ? undefined : commands?.[command - 1];
  return found ? t("twin.at_part", { at, number: command ?? 0, name: nameOfCommand(found) }) : t("twin.at", { at });
}

/** Mark of the verdict about a record. @param {{ type: Type, id: number }} props */
export function VerdictMark({ type, id }) {
  const found = verdictOf(type, id);
  if (found === null) return null;
  const when = found.fall === null ? "" : whenOf(type, id, found.fall);
  const text = t(`twin.${found.verdict}`, { when });
  return html`<span class="verdict ${found.verdict}" role="img" aria-label=${text} title=${text}><${Icon} name=${ICON_OF[found.verdict]} /></span>`;
}

/** Have the draft judged after each edit, while the component is on the screen. */
export function useVerdicts() {
  useEffect(() => {
    const timer = setTimeout(judge, PAUSE);
    return () => clearTimeout(timer);
  }, [draft.value, figure.value, hasTwin.value]);
}
