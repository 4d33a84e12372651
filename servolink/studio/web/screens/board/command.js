// A command for a terminal, and a button that copies it.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { copyText } from "../../parts/copy-text.js";
import { safeText } from "../../parts/safe-text.js";
import { toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";

/** @param {{ text: string }} props */
export function Command({ text }) {
  const copy = async () => {
    if (await copyText(text)) toast({ kind: "ok", title: t("board.copied") });
    else toast({ kind: "bad", title: t("board.not_copied") });
  };
  return html`<div class="cmd">
    <code>${safeText(text)}</code>
    <button class="btn s ic ghost" aria-label=${t("board.copy")} title=${t("board.copy")} onClick=${copy}><${Icon} name="copy" /></button>
  </div>`;
}
