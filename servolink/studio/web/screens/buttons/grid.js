// Buttons as numbers, for remote controls that are no common gamepads.

import { html, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { t } from "../../texts/text.js";
import { pressing } from "./pad.js";

const MOST_ID = 2 ** 32 - 1;

/** @param {{ ids: number[], onAdd: (id: number) => void } & import("./pad.js").Shown} props */
export function Grid({ ids, onAdd, chosen, isSet, isDown, caption, macro, onPress, onRelease }) {
  return html`<div class="padgrid" role="group" aria-label=${t("buttons.grid")}>
    ${ids.map((id) => {
      const classes = ["gb", isSet(id) && "set", isDown(id) && "down"].filter(Boolean).join(" ");
      return html`<button key=${id} class=${classes} aria-pressed=${String(chosen === id)} ...${pressing(id, onPress, onRelease)}>
        <b class="num">${id}</b><span class="ell">${caption(id) || macro(id)}</span>
      </button>`;
    })}
    <${AddButton} onAdd=${onAdd} />
  </div>`;
}

/** @param {{ onAdd: (id: number) => void }} props */
function AddButton({ onAdd }) {
  const [text, setText] = useState("");
  const id = Number(text),
    isGood = text !== "" && Number.isInteger(id) && id >= 0 && id <= MOST_ID;
  /** @param {SubmitEvent} event */
  const add = (event) => {
    event.preventDefault();
    if (!isGood) return;
    onAdd(id);
    setText("");
  };
  return html`<form class="row" onSubmit=${add}>
    <input class="inp s" inputmode="numeric" aria-label=${t("buttons.number")} placeholder=${t("buttons.number")} value=${text}
      onInput=${(/** @type {Event} */ event) => setText(/** @type {HTMLInputElement} */ (event.currentTarget).value.trim())} />
    <button class="btn s ic" aria-label=${t("buttons.add_button")} disabled=${!isGood}><${Icon} name="plus" /></button>
  </form>`;
}
