// A command for a terminal, and a button that copies it.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { safeText } from "../../parts/safe-text.js";
import { toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";

/** @param {{ text: string }} props */
export function Command({ text }) {
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text);
      toast({ kind: "ok", title: t("board.copied") });
    } catch {
      toast({ kind: "bad", title: t("board.not_copied") }); // browsers allow copying only to pages of this machine, or with TLS
    }
  };
  return html`<div class="cmd">
    <code>${safeText(text)}</code>
    <button class="btn s ic ghost" aria-label=${t("board.copy")} title=${t("board.copy")} onClick=${copy}><${Icon} name="copy" /></button>
  </div>`;
}
