// Chosen servo: readings, and buttons to release or start the servo.

import { html, useRef, useSignalEffect } from "../../html.js";
import { limbOf, nameOf } from "../../state/figure.js";
import { isLive, isOthers, isRead, mayMove, servoIds, servos } from "../../state/robot.js";
import { toast } from "../../state/toasts.js";
import { chosen } from "../../state/view.js";
import { degrees, t } from "../../texts/text.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

const ROWS = /** @type {const} */ ([
  ["angle", "live.angle"],
  ["current_raw", "live.current_raw"],
  ["temperature_raw", "live.temperature_raw"],
]);

/** @param {Tools} tools */
export function Inspector({ link }) {
  const card = useRef(/** @type {HTMLElement | null} */ (null));
  const id = chosen.value ?? servoIds.value[0];
  useSignalEffect(() => {
    const servo = servos.value.get(chosen.value ?? servoIds.value[0]);
    if (card.current === null || servo === undefined) return;
    for (const [name] of ROWS) {
      const text = !isRead.value ? "\u2013" : name === "angle" ? degrees(servo.angle) : String(servo[name]);
      /** @type {HTMLElement} */ (card.current.querySelector(`[data-part=${name}]`)).textContent = text;
    }
    const state = !isRead.value ? "unread" : servo.is_hold ? (servo.is_start ? "held" : "stopped") : "limp";
    const chip = /** @type {HTMLElement} */ (card.current.querySelector("[data-part=state]"));
    chip.textContent = t(`live.${state}`);
    chip.className = `chip ${{ unread: "", held: "ok", stopped: "warn", limp: "limp" }[state]}`;
    card.current.dataset.state = state;
  });
  if (id === undefined) return null;
  /** @param {{ start: boolean, hold: boolean }} state */
  const set = (state) =>
    link.call("servo.set", { servo: id, ...state }).catch((error) => toast({ kind: "bad", title: error.message }));
  const release = () => {
    if (confirm(t("live.let_go_warning", { name: nameOf(id) }))) set({ start: false, hold: false });
  };
  const isOff = !isLive.value || !mayMove.value || isOthers.value;
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
      <div class="row wrap actions">
        <button class="btn s" disabled=${isOff} onClick=${release}>${t("live.let_go")}</button>
        <button class="btn s" disabled=${!isLive.value || !mayMove.value} onClick=${() => set({ start: false, hold: true })}>${t("live.hold_it")}</button>
        <button class="btn s" disabled=${isOff} onClick=${() => set({ start: true, hold: true })}>${t("live.start_it")}</button>
      </div>
    </div>
  </section>`;
}
