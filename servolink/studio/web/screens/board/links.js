// Links for tablets and other machines: a link to drive and a link to watch; both can be revoked.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";
import { useAnswer } from "./asking.js";
import { Command } from "./command.js";

/** @typedef {"edit" | "watch"} LinkRole */
/** @typedef {{ size: number, path: string }} Qr */
/** @typedef {{ links: { role: LinkRole, host: string, address: string, qr: Qr }[], is_open_to_others: boolean }} Answer */

const ROLES = /** @type {LinkRole[]} */ (["edit", "watch"]);

/** @param {{ link: import("../../link/link.js").Link }} props */
export function LinkCard({ link }) {
  const { answer, ask } = useAnswer(link, "studio.links", () => ({}));
  const known = /** @type {Answer | null} */ (answer);
  if (known === null) return null; // this page was opened through a link itself
  /**
   * @param {LinkRole} role
   * @param {"revoke" | "renew"} action
   */
  const change = async (role, action) => {
    await link
      .call("studio.links.change", { role, action })
      .catch((error) => toast({ kind: "bad", title: safeText(error.message) }));
    await ask();
  };
  return html`<section class="card">
    <header><h2>${t("board.links")}</h2></header>
    <div class="pad0 stack">
      ${!known.is_open_to_others && html`<p class="mut">${t("board.only_here")}</p><${Command} text="servolink studio --host 0.0.0.0 --allow-host NAME" />`}
      ${known.links.some(({ address }) => address.startsWith("http://")) && html`<${Note} kind="warn" title=${t("board.not_encrypted")} detail=${t("board.not_encrypted_detail")} />`}
      ${known.is_open_to_others && ROLES.map((role) => html`<${LinksOf} key=${role} role=${role} links=${known.links.filter((each) => each.role === role)} onChange=${change} />`)}
    </div>
  </section>`;
}

/** @param {{ qr: Qr, host: string }} props */
const Code = ({ qr: { size, path }, host }) => html`<details class="qr">
  <summary>${t("board.qr", { host })}</summary>
  <svg viewBox="0 0 ${size} ${size}" role="img" aria-label=${t("board.qr", { host })}><path d=${path} /></svg>
</details>`;

/** @param {{ role: LinkRole, links: Answer["links"], onChange: (role: LinkRole, action: "revoke" | "renew") => void }} props */
function LinksOf({ role, links, onChange }) {
  const isThere = links.length > 0;
  return html`<div class="stack">
    <div class="row"><h3 class="grow">${role === "edit" ? t("board.link_drives") : t("board.link_watches")}</h3>
      ${
        isThere
          ? html`<button class="btn s danger" onClick=${() => onChange(role, "revoke")}><${Icon} name="close" />${t("board.revoke")}</button>`
          : html`<button class="btn s" onClick=${() => onChange(role, "renew")}><${Icon} name="plus" />${t("board.new_link")}</button>`
      }
    </div>
    ${links.map(({ address, host, qr }) => html`<${Code} key=${`code ${host}`} qr=${qr} host=${safeText(host)} /><${Command} key=${host} text=${address} />`)}
    ${!isThere && html`<p class="mut">${t("board.revoked")}</p>`}
  </div>`;
}
