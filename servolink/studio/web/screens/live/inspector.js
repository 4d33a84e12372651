// Chosen servo: readings, and buttons to release or start the servo.

import { html, useRef, useSignalEffect } from "../../html.js";
import { Hold } from "../../parts/hold.js";
import { LetGoButton } from "../../parts/let-go-button.js";
import { NumberField } from "../../parts/number-field.js";
import { limbOf, limitsOf, nameOf } from "../../state/figure.js";
import { isFresh, isLive, isOthers, isRead, mayMove, servoIds, servos } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { chosen, draft, draftTarget, mode } from "../../state/view.js";
import { degrees, t } from "../../texts/text.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

const ROWS = /** @type {const} */ ([
  ["angle", "live.angle"],
  ["current_raw", "live.current_raw"],
  ["temperature_raw", "live.temperature_raw"],
]);

/** @param {Tools} tools */
export function Inspector({ link, motion }) {
  const card = useRef(/** @type {HTMLElement | null} */ (null));
  const id = chosen.value ?? servoIds.value[0];
  useSignalEffect(() => {
    const servo = servos.value.get(chosen.value ?? servoIds.value[0]);
    if (card.current === null || servo === undefined) return;
    for (const [name] of ROWS) {
      const text = !isRead.value ? "\u2013" : name === "angle" ? degrees(servo.angle) : String(servo[name]);
      /** @type {HTMLElement} */ (card.current.querySelector(`[data-part=${name}]`)).textContent = text;
    }
    const state = isRead.value ? stateOf(servo) : "unread";
    const chip = /** @type {HTMLElement} */ (card.current.querySelector("[data-part=state]"));
    chip.textContent = t(`live.${state}`);
    chip.className = `chip ${{ unread: "", doubtful: "bad", held: "ok", stopped: "warn", limp: "limp" }[state]}`;
    card.current.dataset.state = state;
  });
  if (id === undefined) return null;
  /** @param {{ start: boolean, hold: boolean }} state */
  const set = (state) =>
    link.call("servo.set", { servo: id, ...state }).catch((error) => toast({ kind: "bad", title: error.message }));
  const isOff = !isLive.value || isOthers.value;
  return html`<section class="card insp" data-g=${limbOf(id)} ref=${card}>
    <header>
      <span class="sid">${id}</span>
      <h2 class="ell">${nameOf(id)}</h2>
      <span class="chip" data-part="state"></span>
    </header>
    <div class="pad0">
      <dl class="kv">
        ${ROWS.map(([name, title]) => html`<dt>${t(title)}</dt><dd data-part=${name}></dd>`)}
      </dl>
      ${
        mayMove.value &&
        html`<${Exact} id=${id} motion=${motion} />
      <div class="row wrap actions">
        <${LetGoButton} id=${id} disabled=${isOff} onYes=${() => set({ start: false, hold: false })} />
        <button class="btn s" disabled=${!isLive.value} onClick=${() => set({ start: false, hold: true })}>${t("live.hold_it")}</button>
        <button class="btn s" disabled=${isOff} onClick=${() => set({ start: true, hold: true })}>${t("live.start_it")}</button>
      </div>`
      }
    </div>
  </section>`;
}

/**
 * Field for the exact target of the servo. In Robot mode the servo moves there while a button is held.
 * @param {{ id: number, motion: import("../../state/motion.js").Motion }} props
 */
function Exact({ id, motion }) {
  const [low, high] = limitsOf(id),
    target = draft.value[id],
    reading = Math.round(servos.peek().get(id)?.angle ?? 0); // from which the arrow keys begin
  const shown = (/** @type {number} */ angle) => (target === undefined && angle === reading ? "" : degrees(angle));
  const isOff = !isFresh.value;
  const go = async () => {
    if (target !== undefined && (await motion.begin())) motion.towards({ [id]: target });
  };
  return html`<label class="exact"><span>${t("live.exact")}</span>
      <${NumberField} classes="s" label=${t("live.exact_of", { name: nameOf(id) })} value=${target ?? reading} format=${shown} low=${low} high=${high} disabled=${isOff}
        onChange=${(/** @type {number} */ angle) => draftTarget(id, Math.round(angle))} />
    </label>
    ${mode.value === "robot" && target !== undefined && html`<div class="exact"><${Hold} label=${t("live.exact_go", { angle: degrees(target) })} classes="small" hasKey=${false} disabled=${isOff || isOthers.value} onBegin=${go} onEnd=${() => motion.end()} /></div>`}`;
}

/** @param {import("../../state/robot.js").Servo} servo @returns {"doubtful" | "limp" | "held" | "stopped"} */
function stateOf(servo) {
  if (servo.doubt) return "doubtful";
  if (!servo.is_hold) return "limp";
  return servo.is_start ? "held" : "stopped";
}
