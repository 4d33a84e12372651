// Button with a question before the action: a dialog of the page, as a dialog of the browser would cover STOP.

import { html, useState } from "../html.js";
import { t } from "../texts/text.js";
import { Dialog } from "./dialog.js";

/**
 * @typedef {object} Question
 * @property {string} title
 * @property {string} [detail]
 * @property {string} [sure] text of a box to tick before the answer
 * @property {string} yes
 */

/** @param {{ question: Question | null, onYes: () => void, kind?: string, label?: string, disabled?: boolean, children?: any }} props */
export function AskButton({ question, onYes, kind = "", label, disabled = false, children }) {
  const [asks, setAsks] = useState(false),
    [isSure, setSure] = useState(false);
  const close = () => {
    setAsks(false);
    setSure(false);
  };
  const answer = () => {
    close();
    onYes();
  };
  return html`<button class="btn s ${kind}" aria-label=${label} disabled=${disabled} onClick=${() => (question ? setAsks(true) : onYes())}>${children}</button>
    ${
      asks &&
      question &&
      html`<${Dialog} title=${question.title} onClose=${close}>
        <div class="stack">
          ${question.detail && html`<p>${question.detail}</p>`}
          ${question.sure && html`<label class="sw"><input type="checkbox" checked=${isSure} onChange=${() => setSure(!isSure)} />${question.sure}</label>`}
          <div class="row wrap actions">
            <button class="btn danger" disabled=${question.sure !== undefined && !isSure} onClick=${answer}>${question.yes}</button>
            <button class="btn" onClick=${close}>${t("figure.cancel")}</button>
          </div>
        </div>
      </${Dialog}>`
    }`;
}
