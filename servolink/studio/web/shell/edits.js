// Undo and redo for all screens, and whether the edits are kept.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { safeText } from "../parts/safe-text.js";
import { conflict, differences, draft, edit, keeping, redo, redoLabel, undo, undoLabel } from "../state/project.js";
import { withEdit } from "../state/records.js";
import { mayEdit } from "../state/robot.js";
import { toast } from "../state/toasts.js";
import { t } from "../texts/text.js";

/** @typedef {import("../state/undo.js").Label} Label */

const LASTS = 20_000; // milliseconds in which people can keep their own edit

/** Buttons to undo and redo edits. */
export function Edits() {
  if (draft.value === null || !mayEdit.value) return null;
  return html`<div class="row edits">
      <${EditButton} icon="undo" label=${undoLabel.value} none="edit.undo" what="edit.undo_what" onClick=${undoEdit} />
      <${EditButton} icon="redo" label=${redoLabel.value} none="edit.redo" what="edit.redo_what" onClick=${redoEdit} />
    </div>`;
}

/** Number of differences from the board, and where they are kept. */
export function Unwritten() {
  const count = differences.value.length;
  if (draft.value === null || count === 0) return null;
  return html`<p class=${`unwritten ${keeping.value}`} role="status"><b>${t("edit.not_written", { count })}</b> <span class="mut">${t(`edit.${keeping.value}`)}</span></p>`;
}

conflict.subscribe((found) => {
  if (found === null) return;
  const { theirs, mine, isDeleted } = found,
    { kind, id, who } = theirs,
    record = theirs.record ?? mine;
  const name = safeText(record?.action_caption || record?.macro_caption || record?.table_caption || String(id));
  const keep = () =>
    edit([isDeleted ? "edit.did_bring_back" : "edit.did_keep_mine", { name }], (project) =>
      withEdit(project, { kind, id, record: mine }),
    );
  toast({
    name: `conflict ${kind} ${id}`,
    lasts: LASTS,
    kind: "bad",
    title: t(isDeleted ? "edit.deleted" : "edit.conflict", { who: safeText(who) || t("edit.another_page"), name }),
    detail: t(isDeleted ? "edit.deleted_detail" : "edit.conflict_detail"),
    action: { label: t(isDeleted ? "edit.bring_back" : "edit.keep_mine"), run: keep },
  });
});

/** Undo the latest edit, and show a message about it. */
export function undoEdit() {
  const label = undo();
  if (label) toast({ name: "edit", icon: "undo", title: t("edit.undone"), detail: t(...label) });
}

/** Redo the edit that was undone last, and show a message about it. */
export function redoEdit() {
  const label = redo();
  if (label) toast({ name: "edit", icon: "redo", title: t("edit.redone"), detail: t(...label) });
}

/** @param {{ icon: string, label: Label | null, none: Label[0], what: Label[0], onClick: () => void }} props */
function EditButton({ icon, label, none, what, onClick }) {
  const text = label === null ? t(none) : t(what, { what: t(...label) });
  return html`<button class="btn ic ghost" disabled=${label === null} aria-label=${text} title=${text} onClick=${onClick}><${Icon} name=${icon} /></button>`;
}
