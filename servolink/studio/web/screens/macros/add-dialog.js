// Chooses the action or the macro to add.

import { html } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { safeText } from "../../parts/safe-text.js";
import { callable } from "../../state/edit-macro.js";
import { draft } from "../../state/project.js";
import { poseOf } from "../../state/records.js";
import { t } from "../../texts/text.js";
import { insertCommand, macro, nameOfMacro } from "../../state/shown-macro.js";

/** @param {{ type: "action" | "macro", onClose: () => void }} props */
export function AddDialog({ type, onClose }) {
  const actions = draft.value?.actions ?? [];
  const macros = draft.value && macro.value ? callable(draft.value, macro.value) : [];
  const count = type === "action" ? actions.length : macros.length;
  /** @param {number} id */
  const choose = (id) => {
    onClose();
    insertCommand(type, id);
  };
  return html`<${Dialog} title=${t(type === "action" ? "macros.add_action" : "macros.add_macro")} onClose=${onClose}>
    ${count === 0 && html`<p class="mut">${t("macros.nothing_to_add")}</p>`}
    ${
      type === "action"
        ? html`<div class="poses wide">${actions.map(
            (one) => html`<button class="pose" onClick=${() => choose(one.action_id)}>
          <${PosePicture} pose=${poseOf(one)} /><div><b class="ell">${safeText(one.action_caption) || t("actions.unnamed", { id: one.action_id })}</b></div>
        </button>`,
          )}</div>`
        : macros.map(
            (one) =>
              html`<button class="mrow" onClick=${() => choose(one.macro_id)}><span class="sid">${one.macro_id}</span><b class="ell">${nameOfMacro(one)}</b></button>`,
          )
    }
  </${Dialog}>`;
}
