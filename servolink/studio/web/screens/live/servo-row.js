// One servo: where it is, where it is to go, current and temperature. It is drawn up to 50 times a second, so what
// changes then is written into the page directly.

import { html, useRef, useSignalEffect } from "../../html.js";
import { limitsOf, nameOf } from "../../state/figure.js";
import { targets } from "../../state/motion.js";
import { isLive, isOthers, mayMove, servos } from "../../state/robot.js";
import { chosen, draft, mode } from "../../state/view.js";
import { degrees, t } from "../../texts/text.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

const SAME = 2; // degrees by which target and angle may differ without being told apart
const FULL_CURRENT = 1000,
  FULL_TEMPERATURE = 1000; // raw; the document gives no units, so the bars compare only

/** @param {{ id: number } & Tools} props */
export function ServoRow({ id, motion }) {
  const row = useRef(/** @type {HTMLElement | null} */ (null));
  const isDragged = useRef(false);
  const [low, high] = limitsOf(id);
  useSignalEffect(() => {
    if (row.current !== null) show(row.current, id, isDragged.current);
  });
  /** @param {Event} event */
  const input = (event) => drag(id, Number(/** @type {HTMLInputElement} */ (event.currentTarget).value), motion);
  const begin = () => {
    isDragged.current = true;
    chosen.value = id;
    if (mode.value === "robot") motion.begin();
  };
  const end = () => {
    isDragged.current = false;
    if (mode.value === "robot") motion.end();
  };
  const isOff = !isLive.value || !mayMove.value || (isOthers.value && mode.value === "robot");
  return html`<li ref=${row} class=${chosen.value === id ? "sv sel" : "sv"}>
    <span class="sid">${id}</span>
    <button class="nm ell" aria-pressed=${String(chosen.value === id)} onClick=${() => (chosen.value = id)}>${nameOf(id)}</button>
    <span class="val num"><span data-part="angle"></span><small data-part="target"></small></span>
    <div class="track">
      <div class="bg"></div>
      <div class="zero" style=${{ left: `${share(0, low, high)}%` }}></div>
      <div class="act" data-part="bar"></div>
      <div class="now" data-part="now"></div>
      <input type="range" min=${low} max=${high} step="1" disabled=${isOff} data-part="slider"
        aria-label=${t("live.target_of", { id, caption: nameOf(id) })}
        onPointerDown=${begin} onPointerUp=${end} onPointerCancel=${end} onLostPointerCapture=${end} onInput=${input}
        onKeyDown=${(/** @type {KeyboardEvent} */ event) => !event.repeat && isArrow(event) && begin()}
        onKeyUp=${(/** @type {KeyboardEvent} */ event) => isArrow(event) && end()} onBlur=${end} />
    </div>
    <div class="mt" role="img" data-part="meters"><span><i data-part="current"></i></span><span><i data-part="temperature"></i></span></div>
  </li>`;
}

/**
 * Draft an angle, or move the servo there.
 * @param {number} id
 * @param {number} angle
 * @param {import("../../state/motion.js").Motion} motion
 */
export function drag(id, angle, motion) {
  if (mode.value === "robot") motion.towards({ [id]: angle });
  else draft.value = { ...draft.value, [id]: angle };
}

/**
 * Write the latest reading of a servo into its row.
 * @param {HTMLElement} row
 * @param {number} id
 * @param {boolean} isDragged
 */
function show(row, id, isDragged) {
  const servo = servos.value.get(id),
    [low, high] = limitsOf(id);
  const wanted = (mode.value === "robot" ? targets.value : draft.value)[id];
  if (servo === undefined) return;
  /** @param {string} name */
  const part = (name) => /** @type {HTMLElement} */ (row.querySelector(`[data-part=${name}]`));
  const at = share(servo.angle, low, high),
    zero = share(0, low, high);
  part("angle").textContent = degrees(servo.angle);
  part("target").textContent =
    wanted !== undefined && Math.abs(wanted - servo.angle) > SAME ? `\u2192 ${degrees(wanted)}` : "";
  part("bar").style.left = `${Math.min(at, zero)}%`;
  part("bar").style.width = `${Math.abs(at - zero)}%`;
  part("now").style.left = `${at}%`;
  part("current").style.height = `${Math.min(100, (servo.current_raw / FULL_CURRENT) * 100)}%`;
  part("temperature").style.height = `${Math.min(100, (servo.temperature_raw / FULL_TEMPERATURE) * 100)}%`;
  const meters = `${t("live.current", { value: servo.current_raw })}, ${t("live.temperature", { value: servo.temperature_raw })}`;
  part("meters").title = meters;
  part("meters").setAttribute("aria-label", meters);
  row.dataset.state = servo.is_hold ? (servo.is_start ? "ready" : "stopped") : "limp";
  const slider = /** @type {HTMLInputElement} */ (part("slider"));
  if (!isDragged) slider.value = String(wanted ?? servo.angle);
}

/**
 * Return where an angle is between two others, 0..100.
 * @param {number} angle
 * @param {number} low
 * @param {number} high
 */
const share = (angle, low, high) => Math.max(0, Math.min(100, ((angle - low) / (high - low)) * 100));

/** @param {KeyboardEvent} event */
const isArrow = (event) => event.key.startsWith("Arrow") || ["Home", "End", "PageUp", "PageDown"].includes(event.key);
