// Button to let a servo go, with a question before.

import { html } from "../html.js";
import { nameOf } from "../state/figure.js";
import { t } from "../texts/text.js";
import { AskButton } from "./ask-button.js";
import { Icon } from "./icon.js";

/** @param {{ id: number, disabled: boolean, onYes: () => void }} props */
export function LetGoButton({ id, disabled, onYes }) {
  const question = {
    title: t("live.let_go_ask", { name: nameOf(id) }),
    detail: t("live.let_go_warning"),
    yes: t("live.let_go"),
  };
  return html`<${AskButton} disabled=${disabled} question=${question} onYes=${onYes}><${Icon} name="feather" />${t("live.let_go")}</${AskButton}>`;
}
