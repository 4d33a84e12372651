// The three steps: choose and release limbs, pose and take, name and save.

import { html, useEffect, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { limbName, limbs } from "../../state/figure.js";
import { failure } from "../../state/limp.js";
import { reading } from "../../state/project.js";
import { isOthers, mayMove } from "../../state/robot.js";
import {
  chosenIds,
  chosenLimbs,
  film,
  forgetLast,
  holdAgain,
  isLimp,
  mayRelease,
  maySave,
  name,
  nameLesson,
  problem,
  releaseLimbs,
  saveLesson,
  takePose,
  toggleLimb,
} from "../../state/teaching.js";
import { t } from "../../texts/text.js";

/** @typedef {import("../../link/link.js").Link} Link */

const MOST_CHARACTERS = 32;

/** @param {{ link: Link }} props */
export function Steps({ link }) {
  const now = isLimp.value ? 2 : film.value.length > 0 ? 3 : 1;
  return html`<section class="card side" aria-label=${t("teach.steps")}>
    <header><h2>${t("teach.title")}</h2></header>
    <ol class="nums">
      <${Step} number=${1} now=${now} title=${t("teach.choose")}><${Choose} link=${link} /></${Step}>
      <${Step} number=${2} now=${now} title=${t("teach.pose_it")}><${Take} /></${Step}>
      <${Step} number=${3} now=${now} title=${t("teach.keep_it")}><${Keep} /></${Step}>
    </ol>
  </section>`;
}

/** @param {{ number: number, now: number, title: string, children?: any }} props */
function Step({ number, now, title, children }) {
  const isDone = number < now;
  return html`<li class=${isDone ? "done" : number === now ? "now" : ""} aria-current=${number === now ? "step" : undefined}>
    <i>${isDone ? html`<${Icon} name="check" />` : number}</i>
    <div class="step-body"><h3>${title}</h3>${children}</div>
  </li>`;
}

/** @param {{ link: Link }} props */
function Choose({ link }) {
  const reason = !mayMove.value ? t("note.watching") : isOthers.value ? t("live.no_control") : "";
  return html`<div class="limbpick" role="group" aria-label=${t("teach.choose")}>
      ${limbs.value.map(
        ({ limb, ids }) => html`<button key=${limb} data-g=${limb} disabled=${isLimp.value}
        aria-pressed=${String(chosenLimbs.value.has(limb))} onClick=${() => toggleLimb(limb)}>
        <b><span class="gd" data-g=${limb}></span>${limbName(limb)}</b><small class="num">${span(ids)}</small>
      </button>`,
      )}
    </div>
    <${Note} kind="warn" title=${t("teach.they_fall")} detail=${t("teach.they_fall_detail")} />
    ${
      isLimp.value
        ? html`<button class="btn" onClick=${holdAgain}><${Icon} name="lock" />${t("teach.hold")}</button>`
        : html`<button class="btn letgo" disabled=${!mayRelease.value || chosenIds.value.length === 0} onClick=${() => releaseLimbs(link)}>
          <${Icon} name="feather" />${reason || t("teach.let_go")}
        </button>`
    }
    ${failure.value && html`<${Note} kind="bad" urgent title=${t("teach.not_held")} detail=${safeText(failure.value)} />`}`;
}

function Take() {
  const button = useRef(/** @type {HTMLButtonElement | null} */ (null)),
    isReady = isLimp.value;
  useEffect(() => {
    if (isReady) button.current?.focus(); // Space takes a pose now, and does not press what was pressed before
  }, [isReady]);
  return html`<button ref=${button} class="btn pri big" disabled=${!isReady} onClick=${takePose}>
      <${Icon} name="camera" />${t("teach.take")} <kbd>${t("teach.space")}</kbd>
    </button>
    <div class="row wrap">
      <button class="btn s" disabled=${film.value.length === 0} onClick=${forgetLast}>
        <${Icon} name="undo" />${t("teach.forget")} <kbd>U</kbd>
      </button>
      <span class="mut">${t("teach.or_button")}</span>
    </div>`;
}

function Keep() {
  const count = film.value.length,
    { state } = reading.value;
  /** @param {Event} event */
  const submit = (event) => {
    event.preventDefault();
    if (maySave.value) saveLesson();
  };
  const why = state === "failed" ? t("project.not_read") : problem.value ? t(problem.value) : "";
  return html`<form class="row" onSubmit=${submit}>
      <input class="inp grow" aria-label=${t("teach.name")} placeholder=${t("teach.name")} maxlength=${MOST_CHARACTERS} value=${name.value}
        autocomplete="off" aria-describedby="teach-keep" aria-invalid=${String(why !== "")}
        onInput=${(/** @type {Event} */ event) => nameLesson(/** @type {HTMLInputElement} */ (event.currentTarget).value)} />
      <button class="btn" disabled=${!maySave.value}>${t("teach.save")}</button>
    </form>
    <p id="teach-keep" class=${why ? "bad" : "mut"} aria-live="polite">
      ${why || (count > 1 ? t("teach.makes_macro", { count }) : count === 1 ? t("teach.makes_action") : t("teach.makes_nothing"))}
      ${!why && count > 0 && ` ${t("teach.held_before")}`}
    </p>`;
}

/**
 * Return the ids of servos as people read them, such as `1–3` or `1, 4, 7`.
 * @param {number[]} ids
 */
function span(ids) {
  const last = ids.at(-1) ?? 0,
    isRow = ids.length > 2 && last - ids[0] === ids.length - 1;
  return isRow ? `${ids[0]}\u2013${last}` : ids.join(", ");
}
