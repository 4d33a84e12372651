// Button that opens the dialog for pasting motions of another robot.

import { html, useState } from "../html.js";
import { t } from "../texts/text.js";
import { Icon } from "./icon.js";
import { PasteDialog } from "./paste.js";

/** @param {{ isWide?: boolean }} props */
export function PasteButton({ isWide = false }) {
  const [isOpen, setOpen] = useState(false);
  return html`<button class=${isWide ? "btn" : "btn s ic"} aria-label=${t("paste.button")} title=${t("paste.button")} onClick=${() => setOpen(true)}>
      <${Icon} name="paste" />${isWide && t("paste.button")}
    </button>
    ${isOpen && html`<${PasteDialog} onClose=${() => setOpen(false)} />`}`;
}
