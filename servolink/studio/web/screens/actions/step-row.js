// Row of one servo in an action: participation, target, and time as a bar.

import { html, useEffect, useRef } from "../../html.js";
import { NumberField } from "../../parts/number-field.js";
import { withDegrees, withoutServo, withTime } from "../../state/edit-action.js";
import { limitsOf, nameOf } from "../../state/figure.js";
import { capOf, within } from "../../state/limits.js";
import { settle } from "../../state/project.js";
import { LONGEST } from "../../state/records.js";
import { mayEdit } from "../../state/robot.js";
import { changeAction, ghostAction, startPose } from "../../state/shown-action.js";
import { chooseServo, chosen } from "../../state/view.js";
import { degrees, seconds, t } from "../../texts/text.js";
import { turn } from "./stage-card.js";

/** @typedef {import("../../state/records.js").Step} Step */

/** @param {{ id: number, step: Step | undefined, speed: number, longest: number }} props */
export function StepRow({ id, step, speed, longest }) {
  const row = useRef(/** @type {HTMLElement | null} */ (null)),
    isChosen = chosen.value === id,
    name = nameOf(id);
  useEffect(() => {
    if (isChosen) row.current?.scrollIntoView({ block: "nearest" });
  }, [isChosen]);
  const join = () => {
    const degree = within(id, startPose(ghostAction.value)[id] ?? 0);
    changeAction(
      step ? "actions.did_leave" : "actions.did_join",
      (one) => (step ? withoutServo(one, id) : withDegrees(one, { [id]: degree })),
      { values: { servo: name } },
    );
  };
  const [low, high] = limitsOf(id);
  return html`<div ref=${row} class="step ${step ? "" : "off"} ${isChosen ? "sel" : ""}" onPointerDown=${() => chooseServo(id)}>
    ${mayEdit.value ? html`<input type="checkbox" checked=${step !== undefined} aria-label=${t("actions.takes_part", { id, name })} onChange=${join} />` : html`<span></span>`}
    <span class="sid">${id}</span>
    <button class="nm ell" aria-pressed=${String(isChosen)} onClick=${() => chooseServo(id)}>${name}</button>
    ${!step && html`<span class="mut stays">${t("actions.stays")}</span>`}
    ${step && !mayEdit.value && html`<span class="num">${degrees(step.degree)}</span><span class="num">${seconds(step.interval_ms / 1000)}</span>`}
    ${
      step &&
      mayEdit.value &&
      html`<${NumberField} classes="s deg" value=${step.degree} format=${degrees} low=${low} high=${high} label=${t("actions.target_of", { name })} onChange=${(/** @type {number} */ degree) => turn(id, degree)} />
      <${TimeBar} id=${id} step=${step} speed=${speed} longest=${longest} />`
    }
  </div>`;
}

/** @param {{ id: number, step: Step, speed: number, longest: number }} props */
function TimeBar({ id, step, speed, longest }) {
  const bar = useRef(/** @type {HTMLElement | null} */ (null));
  const grip = useRef(/** @type {{ x: number, perPixel: number, from: number } | null} */ (null));
  const isFast = speed > capOf(id),
    speedText = speed === Infinity ? "\u221e" : `${Math.round(speed)}°/s`;
  /** @param {number} milliseconds @param {string} [merge] */
  const set = (milliseconds, merge = "") =>
    changeAction("actions.did_time", (one) => withTime(one, milliseconds, id), {
      values: { servo: nameOf(id) },
      merge: merge && `${merge} ${id}`,
    });
  /** @param {PointerEvent} event */
  const grab = (event) => {
    /** @type {Element} */ (event.currentTarget).setPointerCapture(event.pointerId);
    grip.current = { x: event.clientX, perPixel: longest / (bar.current?.clientWidth ?? 100), from: step.interval_ms };
  };
  /** @param {PointerEvent} event */
  const pull = (event) => {
    if (grip.current) set(grip.current.from + (event.clientX - grip.current.x) * grip.current.perPixel, "time");
  };
  const release = () => {
    if (grip.current) settle();
    grip.current = null;
  };
  return html`<div ref=${bar} class=${isFast ? "iv w" : "iv"} title=${speedText}>
    <i style=${{ width: `${Math.max(8, Math.min(100, (step.interval_ms / longest) * 100))}%` }}>
      <b class="edge" onPointerDown=${grab} onPointerMove=${pull} onPointerUp=${release} onPointerCancel=${release} onLostPointerCapture=${release}></b>
    </i>
    <${NumberField} classes="s ivt" value=${step.interval_ms / 1000} format=${seconds} step=${0.01} low=${0} high=${LONGEST / 1000}
      label=${t("actions.time_of", { name: nameOf(id) })} onChange=${(/** @type {number} */ time) => set(time * 1000)} />
    ${isFast && html`<span class="fast">${speedText}</span>`}
  </div>`;
}
