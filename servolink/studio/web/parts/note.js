// A note: the event in bold, its meaning or remedy in plain text, and buttons for remedies.

import { html, useState } from "../html.js";
import { t } from "../texts/text.js";
import { Icon } from "./icon.js";

const ICON_OF = { info: "info", ok: "check", warn: "warn", bad: "warn" };

/** @param {{ kind: "info" | "ok" | "warn" | "bad", title: string, detail?: string, urgent?: boolean, slim?: boolean, children?: any }} props */
export function Note({ kind, title, detail = "", urgent = false, slim = false, children }) {
  const [isOpen, setOpen] = useState(false);
  return html`<div class="note ${kind} ${slim ? "slim" : ""} ${isOpen ? "open" : ""}" role=${urgent ? "alert" : "note"}>
    <${Icon} name=${ICON_OF[kind]} />
    <div class="grow">
      <p><b>${title}</b></p>
      ${detail && html`<p>${detail}</p>`}
    </div>
    ${detail && html`<button class="btn s ic more only-n" aria-expanded=${String(isOpen)} aria-label=${t("app.details")} onClick=${() => setOpen(!isOpen)}><${Icon} name="info" /></button>`}
    ${children && html`<div class="row">${children}</div>`}
  </div>`;
}
