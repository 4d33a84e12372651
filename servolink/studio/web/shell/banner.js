// The line that says that nothing real moves; it cannot be closed.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { welcome } from "../state/robot.js";
import { t } from "../texts/text.js";

export function Banner() {
  if (!welcome.value?.is_virtual) return null;
  return html`<aside class="banner" aria-label=${t("banner.title")}>
    <${Icon} name="chip" /><b>${t("banner.title")}</b><span>${t("banner.nothing_moves")}</span>
    <span class="hide-n faint">${t("banner.connect")}</span>
  </aside>`;
}
