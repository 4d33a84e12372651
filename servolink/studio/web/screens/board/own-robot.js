// Robot at a port of this computer, for a page whose studio runs in the page itself.

import { html } from "../../html.js";
import { choosePort, serial } from "../../link/serial-port.js";
import { Icon } from "../../parts/icon.js";
import { t } from "../../texts/text.js";

/** Button for the browser's list of ports; in browsers without Web Serial, the names of others. */
/** @param {{ actions: import("./robots.js").Actions }} props */
export function OwnRobot({ actions }) {
  const choose = async () => {
    const url = await choosePort();
    if (url !== null) actions.use(url);
  };
  return html`<div class="stack">
    ${
      serial()
        ? html`<div class="row"><button class="btn pri" disabled=${actions.busy !== ""} onClick=${choose}><${Icon} name="usb" />${t("robots.own")}</button></div>`
        : html`<p>${t(window.isSecureContext ? "robots.no_ports" : "robots.no_https")}</p>`
    }
    <p class="mut">${t("robots.elsewhere")}</p>
  </div>`;
}
