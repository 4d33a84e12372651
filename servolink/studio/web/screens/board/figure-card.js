// Which figure stands for the robot, and how to change it.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { toast } from "../../state/toasts.js";
import { safeText } from "../../parts/safe-text.js";
import { figure, ownFigure, saveFigure } from "../../state/figure.js";
import { beginFit } from "../../state/fitting.js";
import { isLive, welcome } from "../../state/robot.js";
import { t } from "../../texts/text.js";

/** @param {{ link: import("../../link/link.js").Link }} props */
export function FigureCard({ link }) {
  const known = figure.value,
    isOwn = ownFigure.value !== null;
  const mayEdit = welcome.value?.role === "edit";
  const useTemplate = () => {
    const before = ownFigure.value,
      action = { label: t("edit.undo"), run: () => save(link, before) };
    save(link, null).then(() => toast({ kind: "ok", title: t("figure.use_template"), action }));
  };
  return html`<section class="card">
    <header><h2>${t("figure.title")}</h2>${known && html`<span class="chip">${safeText(known.data.name)}</span>`}</header>
    <div class="pad0 stack">
      <p class="mut">${t(known === null ? "figure.none" : isOwn ? "figure.is_own" : "figure.is_template")}</p>
      ${
        mayEdit &&
        html`<div class="row wrap">
        <button class="btn s" disabled=${!isLive.value} onClick=${beginFit}><${Icon} name="live" />${t("figure.fit")}</button>
        ${isOwn && html`<button class="btn s" onClick=${useTemplate}>${t("figure.use_template")}</button>`}
      </div>`
      }
    </div>
  </section>`;
}

/**
 * @param {import("../../link/link.js").Link} link
 * @param {import("../../state/figure.js").FigureData | null} data
 */
const save = (link, data) =>
  saveFigure(link, data).catch((error) => toast({ kind: "bad", title: safeText(error.message) }));
