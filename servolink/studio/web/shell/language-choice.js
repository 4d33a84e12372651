// Choice of the language: an icon below an invisible list of languages.

import { html } from "../html.js";
import { Icon } from "../parts/icon.js";
import { chooseLanguage } from "../state/settings.js";
import { LANGUAGES, language, t } from "../texts/text.js";

/** @typedef {import("../texts/text.js").Language} Language */

/** Choice of the language, as large as the element around the icon. */
export function LanguageChoice() {
  const choose = (/** @type {Event} */ event) => {
    const { value } = /** @type {HTMLSelectElement} */ (event.target);
    chooseLanguage(/** @type {Language} */ (value)).catch(() => {}); // without the studio the language stays
  };
  return html`<${Icon} name="language" />
    <select class="lang" aria-label=${t("app.language")} title=${t("app.language")} value=${language.value} onChange=${choose}>
      ${Object.entries(LANGUAGES).map(([tag, name]) => html`<option value=${tag} lang=${tag}>${name}</option>`)}
    </select>`;
}
