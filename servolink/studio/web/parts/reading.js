// Progress of reading the board, or the reason of a failure, until the content is known.

import { html, useEffect } from "../html.js";
import { open, reading, reread } from "../state/project.js";
import { isLive } from "../state/robot.js";
import { t } from "../texts/text.js";
import { Icon } from "./icon.js";
import { safeText } from "./safe-text.js";

/** @param {{ link: import("../link/link.js").Link, icon: string }} props */
export function Reading({ link, icon }) {
  const { state, done, total, item, error } = reading.value,
    mayAsk = isLive.value;
  useEffect(() => {
    if (mayAsk) open(link);
  }, [mayAsk]);
  if (state === "failed") {
    return html`<div class="card empty" role="alert">
      <${Icon} name="warn" />
      <h1>${t("project.not_read")}</h1>
      <p>${safeText(error)}</p>
      <div class="row"><button class="btn pri" onClick=${() => reread(link)}>${t("project.read_again")}</button></div>
    </div>`;
  }
  return html`<div class="card empty" role="status">
    <${Icon} name=${icon} />
    <h1>${t("project.reading")}</h1>
    <progress max=${total || 1} value=${total ? done : undefined} aria-label=${t("project.reading")} />
    <p class="num">${total ? t("project.reading_of", { done, total, item: safeText(item) }) : t("project.reading_lists")}</p>
  </div>`;
}
