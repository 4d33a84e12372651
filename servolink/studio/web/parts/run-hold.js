// Button that moves the robot while held, by the page as edited, or by the board as stored there.

import { html, useState } from "../html.js";
import { mayMove } from "../state/robot.js";
import { t } from "../texts/text.js";
import { HoldButton } from "./hold-button.js";
import { Segments } from "./segments.js";

/** Record on the board, null if it differs from the draft. @typedef {{ type: "action" | "macro", id: number, seconds: number } | null} StoredMotion */

/** @param {{ label: string, stored: StoredMotion, disabled?: boolean, motion: import("../state/motion.js").Motion, onBegin: () => void }} props */
export function RunHold({ label, stored, disabled = false, motion, onBegin }) {
  const [isByBoard, setByBoard] = useState(false);
  if (!mayMove.value) return null;
  const begin = () => {
    if (!isByBoard) onBegin();
    else if (stored) motion.run(stored.type, stored.id, stored.seconds, true);
  };
  const shown = !isByBoard ? label : t(stored ? "run.hold" : "run.unwritten");
  return html`<div class="runhold">
    <${Segments} small label=${t("run.by")} value=${isByBoard ? "board" : "page"} onChoose=${(/** @type {string} */ by) => setByBoard(by === "board")}
      choices=${[
        { value: "page", label: t("run.page") },
        { value: "board", label: t("run.board") },
      ]} />
    <${HoldButton} label=${shown} disabled=${isByBoard ? stored === null : disabled} onBegin=${begin} onEnd=${() => motion.end()} />
  </div>`;
}
