// A dialog over the page, but not over STOP. Escape closes it, and stops the robot unless nothing moves.

import { html, useEffect, useRef } from "../html.js";
import { t } from "../texts/text.js";
import { Icon } from "./icon.js";
import { StopButton } from "./stop-button.js";

const FIELD = ".body input:is(:not([type]), [type=text])";

/** @param {{ title: string, onClose: () => void, children?: any }} props */
export function Dialog({ title, onClose, children }) {
  const element = useRef(/** @type {HTMLDialogElement | null} */ (null));
  useEffect(() => {
    element.current?.showModal();
    /** @type {HTMLInputElement | null | undefined} */ (element.current?.querySelector(FIELD))?.select();
  }, []);
  return html`<dialog ref=${element} onClose=${onClose} aria-labelledby="dialog-title">
    <header>
      <h2 id="dialog-title">${title}</h2>
      <button class="btn ic ghost" aria-label=${t("app.close")} onClick=${() => element.current?.close()}>
        <${Icon} name="close" />
      </button>
    </header>
    <div class="body">${children}</div>
    <${StopButton} />
  </dialog>`;
}
