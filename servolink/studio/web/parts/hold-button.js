// Button that moves the robot while held, or says why the robot cannot move.

import { html } from "../html.js";
import { refusal } from "../state/motion.js";
import { isLive, isOthers, mayMove } from "../state/robot.js";
import { t } from "../texts/text.js";
import { Hold } from "./hold.js";
import { safeText } from "./safe-text.js";

/** @param {{ label: string, disabled?: boolean, onBegin: () => void, onEnd: () => void }} props */
export function HoldButton({ label, disabled = false, onBegin, onEnd }) {
  if (!mayMove.value) return null;
  const reason = !isLive.value ? t("live.no_board") : isOthers.value ? t("live.no_control") : "";
  return html`${refusal.value && html`<span class="chip bad" role="alert">${safeText(refusal.value)}</span>`}
    <${Hold} label=${reason || label} room=${label} hint=${t("live.hold_hint")} disabled=${disabled || reason !== ""} onBegin=${onBegin} onEnd=${onEnd} />`;
}
