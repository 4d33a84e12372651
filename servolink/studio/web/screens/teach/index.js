// Teach: limbs go limp, are posed by hand, and each pose that is taken becomes an action.

import { html, useEffect, useRef, useSignalEffect } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { NumberField } from "../../parts/number-field.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { FigureStage } from "../../parts/stage.js";
import { ViewChoice } from "../../parts/view-choice.js";
import { heard } from "../../state/button-events.js";
import { figure, limbName, limbOf, limbs } from "../../state/figure.js";
import { LONGEST, totalOf } from "../../state/film.js";
import { released } from "../../state/limp.js";
import { open } from "../../state/project.js";
import { actualPose, isLive, servoIds, servos } from "../../state/robot.js";
import {
  choosePose,
  chosenLimbs,
  chosenPose,
  endPreview,
  film,
  forgetLast,
  holdAgain,
  isLimp,
  leastOf,
  previewPose,
  previewTime,
  setSeconds,
  takePose,
  toggleLimb,
  togglePreview,
} from "../../state/teaching.js";
import { views } from "../../state/view.js";
import { degrees, list, seconds, t } from "../../texts/text.js";
import { Steps } from "./steps.js";

/** @typedef {import("../../figure/matrix.js").Vector} Vector */
/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function TeachScreen({ link }) {
  const canRead = isLive.value;
  useEffect(() => {
    if (canRead) open(link); // the names that are taken already
  }, [canRead]);
  useEffect(() => leave, []);
  useKeys({ " ": (event) => event.repeat || takePose(), u: forgetLast });
  useRobotButtons();
  if (isLive.value && servoIds.value.length === 0) return html`<${NoServos} />`;
  return html`<h1 class="sr">${t("teach.title")}</h1>
    <div class=${isLive.value ? "teach" : "teach stale"}>
      <${StageCard} />
      <${Steps} link=${link} />
      <${Film} />
    </div>`;
}

function leave() {
  endPreview();
  holdAgain();
}

/** @param {string} kind */
function press(kind) {
  if (!isLimp.peek()) return;
  if (kind === "press") takePose();
  if (kind !== "long_press") return;
  forgetLast();
  holdAgain();
}

/** Any button of the robot takes a pose; a long press, begun as a press, forgets the new pose and ends. */
function useRobotButtons() {
  const last = useRef(heard.peek()[0]?.number ?? 0);
  useSignalEffect(() => {
    const fresh = heard.value.filter(({ number }) => number > last.current).reverse();
    last.current = heard.value[0]?.number ?? last.current;
    for (const { kind } of fresh) press(kind);
  });
  useSignalEffect(() => {
    if (isLimp.value) endPreview(); // a hand on the robot must see the robot
  });
}

const NoServos = () => html`<div class="card empty">
  <${Icon} name="teach" />
  <h1>${t("live.no_servos")}</h1>
  <p>${t("live.no_servos_detail")}</p>
</div>`;

// The robot with its limp limbs in orange, and the pose of the film that is chosen, pale.

const LIMP = /** @type {Vector} */ ([0.82, 0.41, 0.12]);

function StageCard() {
  const names = limbs.value
    .filter(({ ids }) => ids.some((id) => released.value.has(id)))
    .map(({ limb }) => limbName(limb));
  return html`<section class="stage" aria-label=${t("teach.stage")}>
    ${figure.value && html`<${FigureStage} figure=${figure.value} scene=${SCENE} label=${t("teach.stage_aria")} view=${views.teach.value} />`}
    <div class="tl col">
      <${ViewChoice} of="teach" />
      ${names.length > 0 && html`<span class="chip limp"><${Icon} name="feather" />${t("teach.limp", { limbs: list(names) })}</span>`}
    </div>
    <div class="tr">
      ${
        previewTime.value !== null
          ? html`<span class="chip acc"><${Icon} name="eye" />${t("teach.preview_only")}</span>`
          : html`<span class="chip">${isLimp.value ? t("teach.rest_held") : t("teach.all_held")}</span>`
      }
    </div>
  </section>`;
}

const isPreview = () => previewTime.value !== null;

/** @type {import("../../figure/stage.js").Scene} */
const SCENE = {
  pose: () => previewPose() ?? actualPose(),
  ghost: () => (isPreview() || chosenPose.value === null ? null : (film.value[chosenPose.value]?.pose ?? null)),
  tintOf: ({ servo, follows, group }) => {
    const state = servos.value.get(servo ?? follows ?? -1);
    if (isPreview() || state === undefined) return null;
    if (!state.is_hold) return { tint: LIMP, amount: 0.8 };
    return !isLimp.value && chosenLimbs.value.has(group) ? { tint: LIMP, amount: 0.35 } : null;
  },
  onPick: (id) => toggleLimb(limbOf(id)),
};

// Poses taken by hand, as pictures, with the times between.

const STEP = 0.1; // seconds
const FEW = 2; // angles below a picture

function Film() {
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
