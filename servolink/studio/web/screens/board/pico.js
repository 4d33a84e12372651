// Board made of a Pico: the firmware as a file to save, and the steps to bring it onto the Pico by mouse.

import { html, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { saveBytes } from "../../parts/save-bytes.js";
import { t } from "../../texts/text.js";

const MOST_SERVOS = 16;

/** @param {{ link: import("../../link/link.js").Link }} props */
export function PicoCard({ link }) {
  const [servos, setServos] = useState(MOST_SERVOS),
    [error, setError] = useState("");
  const save = async () => {
    try {
      const { name, data } = await link.call("studio.firmware", { servos });
      saveBytes(name, "application/octet-stream", [
        Uint8Array.from(atob(data), (character) => character.charCodeAt(0)),
      ]);
      setError("");
    } catch (failure) {
      setError(failure instanceof Error ? failure.message : String(failure));
    }
  };
  const counts = Array.from({ length: MOST_SERVOS }, (_, index) => index + 1);
  return html`<section class="card"><header><h2>${t("start.pico")}</h2></header>
    <div class="pad0 stack">
      <p>${t("start.pico_detail")}</p>
      <div class="row">
        <label class="field"><span>${t("board.servos")}</span>
          <select class="inp" onChange=${(/** @type {Event} */ event) => setServos(Number(/** @type {HTMLSelectElement} */ (event.currentTarget).value))}>
            ${counts.map((count) => html`<option key=${count} value=${count} selected=${count === servos}>${count}</option>`)}
          </select></label>
        <button class="btn end" onClick=${save}><${Icon} name="save" />${t("start.pico_save")}</button>
      </div>
      ${error && html`<${Note} kind="bad" urgent title=${safeText(error)} />`}
      <ol class="steps"><li>${t("start.pico_boot")}</li><li>${t("start.pico_copy")}</li><li>${t("start.pico_then")}</li></ol>
      <p class="mut">${t("start.pico_wiring")}</p>
    </div>
  </section>`;
}
