// Robot at a port of this computer, for a page whose studio runs in the page itself.

import { html } from "../../html.js";
import { choosePort, schemes } from "../../link/granted.js";
import { Icon } from "../../parts/icon.js";
import { t } from "../../texts/text.js";

/** @type {Record<string, import("../../texts/text.js").Key>} */
const TITLES = { webserial: "robots.own", webusb: "robots.own_usb", webhid: "robots.own_hid" };

/** Buttons for the lists of ports of the browser; in browsers without ports, the names of others. */
/** @param {{ actions: import("./robots.js").Actions }} props */
export function OwnRobot({ actions }) {
  const has = schemes();
  /** @param {import("../../link/granted.js").Scheme} scheme */
  const choose = async (scheme) => {
    const url = await choosePort(scheme);
    if (url !== null) actions.use(url);
  };
  return html`<div class="stack">
    ${
      has.length > 0
        ? html`<div class="row wrap">${has.map((scheme, at) => html`<button key=${scheme} class=${at === 0 ? "btn pri" : "btn s"} disabled=${actions.busy !== ""} onClick=${() => choose(scheme)}>${at === 0 && html`<${Icon} name="usb" />`}${t(at === 0 ? "robots.own" : TITLES[scheme])}</button>`)}</div>`
        : html`<p>${t(window.isSecureContext ? "robots.no_ports" : "robots.no_https")}</p>`
    }
    <p class="mut">${t("robots.elsewhere")}</p>
  </div>`;
}
