// Says what was edited, with a button that undoes just that.

import { undo, undoLabel } from "../state/project.js";
import { t } from "../texts/text.js";
import { toast } from "./toasts.js";

/**
 * Show what the latest edit did. Its button does nothing once there are later edits.
 * @param {{ icon?: string, title: string, detail?: string }} message
 */
export function editToast(message) {
  const label = undoLabel.peek();
  const run = () => undoLabel.peek() === label && undo();
  toast({ name: "edit", ...message, action: { label: t("edit.undo"), run } });
}
