// The poses that were taken, as pictures, with the times between them.

import { html, useEffect, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { NumberField } from "../../parts/number-field.js";
import { PosePicture } from "../../parts/pose-picture.js";
import {
  choosePose,
  chosenPose,
  film,
  isLimp,
  leastOf,
  previewTime,
  setSeconds,
  togglePreview,
} from "../../state/teaching.js";
import { degrees, seconds, t } from "../../texts/text.js";
import { LONGEST, totalOf } from "../../state/lesson.js";

const STEP = 0.1; // seconds
const FEW = 2; // angles below a picture

export function Film() {
  const list = useRef(/** @type {HTMLElement | null} */ (null)),
    count = film.value.length;
  useEffect(() => {
    list.current?.scrollTo({ left: list.current.scrollWidth });
  }, [count]);
  const isPlaying = previewTime.value !== null;
  return html`<section class="card film" aria-label=${t("teach.taken")}>
    <header>
      <h2>${t("teach.taken")} <span class="mut num" role="status">${t("teach.taken_count", { count, time: seconds(totalOf(film.value), 1) })}</span></h2>
      <button class="btn s" disabled=${count === 0 || isLimp.value} onClick=${togglePreview}>
        <${Icon} name=${isPlaying ? "pause" : "play"} />${isPlaying ? t("teach.preview_end") : t("teach.preview")}
      </button>
    </header>
    ${count === 0 ? html`<p class="mut none">${t("teach.none_taken")}</p>` : html`<ol ref=${list}>${film.value.map((_, at) => html`<${Gap} at=${at} /><${Pose} at=${at} />`)}</ol>`}
  </section>`;
}

/** @param {{ at: number }} props */
function Gap({ at }) {
  return html`<li class="gap num">
    <${NumberField} value=${film.value[at].seconds} classes="s" step=${STEP} low=${leastOf(at)} high=${LONGEST} format=${seconds}
      label=${t("teach.time_of", { number: at + 1 })} onChange=${(/** @type {number} */ value) => setSeconds(at, value)} />
    <${Icon} name="arrow" />
  </li>`;
}

/** @param {{ at: number }} props */
function Pose({ at }) {
  const { pose, ids } = film.value[at],
    isChosen = chosenPose.value === at;
  return html`<li>
    <button class="pose" aria-pressed=${String(isChosen)} onClick=${() => choosePose(isChosen ? null : at)}>
      <${PosePicture} pose=${pose} />
      <div>
        <b>${t("teach.pose", { number: at + 1 })}</b>
        <small class="num">${ids
          .slice(0, FEW)
          .map((id) => `${id}: ${degrees(pose[id])}`)
          .join(" · ")}</small>
      </div>
    </button>
  </li>`;
}
