// Backups of the board, one from before each writing; a roll-back shows its differences first.

import { html, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Icon } from "../../parts/icon.js";
import { safeText } from "../../parts/safe-text.js";
import { differencesOf } from "../../state/differences.js";
import { backups, progress, rollBack } from "../../state/plan.js";
import { stored } from "../../state/project.js";
import { isLive, welcome } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { dateAndTime, t } from "../../texts/text.js";
import { Difference } from "./difference.js";

/** @typedef {import("../../state/plan.js").Backup} Backup */
/** @typedef {import("../../state/plan.js").Change} Change */
/** @typedef {import("../../link/link.js").Link} Link */

const SHOWN = 6;

/** @param {{ link: Link, mayWrite: boolean }} props */
export function Backups({ link, mayWrite }) {
  const [showsAll, setShowsAll] = useState(false);
  const [compared, setCompared] = useState(/** @type {{ backup: Backup, changes: Change[] } | null} */ (null));
  const here = backups.value.filter(({ board }) => board === slug(welcome.value?.url ?? ""));
  const shown = showsAll ? here : here.slice(0, SHOWN);
  /** @param {Backup} backup */
  const compare = async (backup) => {
    try {
      const { project } = await link.call("studio.backup", { number: backup.number });
      setCompared({ backup, changes: changesTo(project) });
    } catch (error) {
      toast({
        kind: "bad",
        title: t("project.no_backup"),
        detail: safeText(error instanceof Error ? error.message : ""),
      });
    }
  };
  return html`<section class="card">
    <header><h2>${t("project.backups")}</h2><span class="mut">${t("project.backups_where")}</span></header>
    <div class="pad0">
      ${here.length === 0 && html`<p class="mut">${t("project.no_backups")}</p>`}
      <ul class="bk">
        ${shown.map(
          (backup) => html`<li key=${backup.number}>
          <span><b>${dateAndTime(backup.time)}</b><small class="num">${t("project.backup", { number: backup.number })}</small></span>
          ${mayWrite && html`<button class="btn s" onClick=${() => compare(backup)}>${t("project.roll_back_to")}</button>`}
        </li>`,
        )}
      </ul>
      ${here.length > shown.length && html`<button class="btn s" onClick=${() => setShowsAll(true)}>${t("project.all_backups", { count: here.length })}</button>`}
    </div>
    ${compared && html`<${Compared} ...${compared} link=${link} mayWrite=${mayWrite} onClose=${() => setCompared(null)} />`}
  </section>`;
}

/** @param {{ backup: Backup, changes: Change[], link: Link, mayWrite: boolean, onClose: () => void }} props */
function Compared({ backup, changes, link, mayWrite, onClose }) {
  const go = () => {
    onClose();
    rollBack(link, backup.number);
  };
  return html`<${Dialog} title=${t("project.back_to", { time: dateAndTime(backup.time) })} onClose=${onClose}>
    <p class="mut">${changes.length === 0 ? t("project.same_as_backup") : t("project.roll_back_changes", { count: changes.length })}</p>
    <ul class="diffs">${changes.map((change) => html`<${Difference} key=${change.what} change=${change} />`)}</ul>
    <div class="row wrap actions">
      ${
        mayWrite &&
        html`<button class="btn pri" disabled=${!isLive.value || progress.value !== null || changes.length === 0} onClick=${go}>
        <${Icon} name="rollback" />${t("project.roll_back")}
      </button>`
      }
      <button class="btn" onClick=${onClose}>${t("app.close")}</button>
    </div>
  </${Dialog}>`;
}

/**
 * Return what the board would lose and get with another content.
 * @param {import("../../state/records.js").Project} project
 * @returns {Change[]}
 */
const changesTo = (project) =>
  stored.value === null
    ? []
    : differencesOf(stored.value, project).map(({ kind, id, before, after }) => ({
        what: `${kind} ${id}`,
        old: before ?? null,
        new: after ?? null,
      }));

/**
 * Return an address as it is written in the names of backups (`servolink/project/transfer/backups.py`).
 * @param {string} url
 */
const slug = (url) =>
  url
    .split("?")[0]
    .replace(/[^A-Za-z0-9.]+/g, "_")
    .slice(-60)
    .replace(/^[_.]+|[_.]+$/g, "") || "board";
