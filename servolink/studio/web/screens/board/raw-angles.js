// Angles as the board measures them: raw ADC readings beside the degrees, for a while.

import { html, useEffect, useState } from "../../html.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { nameOf } from "../../state/figure.js";
import { isLive, servos } from "../../state/robot.js";
import { degrees, t } from "../../texts/text.js";

/** @typedef {{ servo_id: number, angle: number }} RawServo */

const PERIOD = 500; // milliseconds between readings: each sets the unit of all servos, and sets degrees again

/** @param {{ link: import("../../link/link.js").Link }} props */
export function RawAnglesCard({ link }) {
  const [isShown, setShown] = useState(false);
  return html`<section class="card" aria-labelledby="raw-title">
    <header><h2 id="raw-title">${t("raw.title")}</h2>
      <button class="btn s" aria-pressed=${String(isShown)} disabled=${!isLive.value} onClick=${() => setShown(!isShown)}>${t(isShown ? "raw.end" : "raw.read")}</button>
    </header>
    <div class="pad0 stack">
      <p class="mut">${t("raw.detail")}</p>
      ${isShown && html`<${Readings} link=${link} />`}
    </div>
  </section>`;
}

/** @param {{ link: import("../../link/link.js").Link }} props */
function Readings({ link }) {
  const [found, setFound] = useState(/** @type {RawServo[]} */ ([])),
    [error, setError] = useState("");
  useEffect(() => {
    let isOver = false,
      timer = 0;
    const read = async () => {
      try {
        const answer = await link.call("servos.list", { unit: "adc" });
        if (!isOver) setFound(answer.servos);
        setError("");
      } catch (failure) {
        setError(failure instanceof Error ? failure.message : "");
      }
      if (!isOver) timer = setTimeout(read, PERIOD);
    };
    read();
    return () => {
      isOver = true;
      clearTimeout(timer);
    };
  }, []);
  return html`${error && html`<${Note} kind="warn" title=${safeText(error)} />`}
    <table class="tbl num">
      <thead><tr><th scope="col">${t("board.servos")}</th><th scope="col">${t("raw.degrees")}</th><th scope="col">${t("raw.adc")}</th></tr></thead>
      <tbody>${found.map(
        ({ servo_id: id, angle }) => html`<tr key=${id}>
          <td><span class="row"><span class="sid">${id}</span><span class="ell">${nameOf(id)}</span></span></td>
          <td>${degrees(servos.peek().get(id)?.angle ?? 0)}</td><td>${angle}</td>
        </tr>`,
      )}</tbody>
    </table>`;
}
