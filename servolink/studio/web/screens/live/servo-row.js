// One servo: angle, target, current and temperature. Readings come up to 50 times a second, so they are written into the
// elements of the row directly.

import { effect, html, useComputed, useLayoutEffect, useRef } from "../../html.js";
import { limitsOf, nameOf } from "../../state/figure.js";
import { targets } from "../../state/motion.js";
import { isFresh, isOthers, isRead, mayMove, servos } from "../../state/robot.js";
import { chooseServo, chosen, draft, draftTarget, mode } from "../../state/view.js";
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
  const isKnown = useComputed(() => knows(id));
  const isOff = !isFresh.value || !isKnown.value || (isOthers.value && mode.value === "robot");
  /** @param {Event} event */
  const input = (event) => drag(id, Number(/** @type {HTMLInputElement} */ (event.currentTarget).value), motion);
  const begin = () => {
    if (isOff) return; // a slider that is disabled is still told of presses
    isDragged.current = true;
    chooseServo(id);
    if (mode.value === "robot") motion.begin();
  };
  const end = () => {
    isDragged.current = false;
    if (mode.value === "robot") motion.end();
  };
  // Before the browser paints, which would show a slider in the middle.
  useLayoutEffect(
    () =>
      effect(() => {
        if (!isKnown.value && isDragged.current) end();
        if (row.current !== null) show(row.current, id, isDragged.current);
      }),
    [id],
  );
  return html`<li ref=${row} class=${chosen.value === id ? "sv sel" : "sv"}>
    <span class="sid">${id}</span>
    <button class="nm ell" aria-pressed=${String(chosen.value === id)} onClick=${() => chooseServo(id)}>${nameOf(id)}</button>
    <span class="val num"><span data-part="angle"></span><small data-part="target"></small></span>
    <div class="track">
      <div class="bg"></div>
      <div class="zero" style=${{ left: `${share(0, low, high)}%` }}></div>
      <div class="act" data-part="bar"></div>
      <div class="now" data-part="now"></div>
      ${
        mayMove.value &&
        html`<input type="range" min=${low} max=${high} step="1" disabled=${isOff} data-part="slider"
        aria-label=${t("live.target_of", { id, caption: nameOf(id) })}
        onPointerDown=${begin} onPointerUp=${end} onPointerCancel=${end} onLostPointerCapture=${end} onInput=${input}
        onKeyDown=${(/** @type {KeyboardEvent} */ event) => !event.repeat && isArrow(event) && begin()}
        onKeyUp=${(/** @type {KeyboardEvent} */ event) => isArrow(event) && end()} onBlur=${end} />`
      }
    </div>
    <div class="mt" role="img" data-part="meters"><span><i data-part="current"></i></span><span><i data-part="temperature"></i></span></div>
  </li>`;
}

/**
 * Return whether a servo was read, and has a known angle.
 * @param {number} id
 */
const knows = (id) => isRead.value && servos.value.has(id);

/**
 * Draft an angle, or move the servo there; do neither before the servo was read.
 * @param {number} id
 * @param {number} angle
 * @param {import("../../state/motion.js").Motion} motion
 */
export function drag(id, angle, motion) {
  if (!knows(id)) return;
  if (mode.value === "robot") motion.towards({ [id]: angle });
  else draftTarget(id, angle);
}

/**
 * Write the latest reading of a servo into its row.
 * @param {HTMLElement} row
 * @param {number} id
 * @param {boolean} isDragged
 */
function show(row, id, isDragged) {
  const servo = isRead.value ? servos.value.get(id) : undefined,
    [low, high] = limitsOf(id);
  const wanted = (mode.value === "robot" ? targets.value : draft.value)[id];
  /** @param {string} name */
  const part = (name) => /** @type {HTMLElement} */ (row.querySelector(`[data-part=${name}]`));
  const slider = /** @type {HTMLInputElement | null} */ (part("slider")); // none on a page that may not move
  if (servo === undefined) {
    row.dataset.state = "unread"; // the style sheet hides everything that looks like an angle
    part("angle").textContent = "\u2013";
    part("target").textContent = "";
    part("meters").title = t("live.unread");
    part("meters").setAttribute("aria-label", t("live.unread"));
    slider?.setAttribute("aria-valuetext", t("live.unread"));
    return;
  }
  slider?.removeAttribute("aria-valuetext");
  const at = share(servo.angle, low, high),
    zero = share(0, low, high);
  part("angle").textContent = servo.doubt ? `${degrees(servo.angle)} ?` : degrees(servo.angle);
  part("target").textContent =
    wanted !== undefined && Math.abs(wanted - servo.angle) > SAME ? `\u2192 ${degrees(wanted)}` : "";
  part("bar").style.left = `${Math.min(at, zero)}%`;
  part("bar").style.width = `${Math.abs(at - zero)}%`;
  part("now").style.left = `${at}%`;
  part("current").style.height = `${Math.min(100, (servo.current_raw / FULL_CURRENT) * 100)}%`;
  part("temperature").style.height = `${Math.min(100, (servo.temperature_raw / FULL_TEMPERATURE) * 100)}%`;
  const doubt = servo.doubt ? `${t("live.doubtful")}: ` : "";
  const meters = `${doubt}${t("live.current", { value: servo.current_raw })}, ${t("live.temperature", { value: servo.temperature_raw })}`;
  part("meters").title = meters;
  part("meters").setAttribute("aria-label", meters);
  row.dataset.state = servo.doubt ? "unread" : servo.is_hold ? (servo.is_start ? "ready" : "stopped") : "limp";
  if (slider && !isDragged) slider.value = String(wanted ?? servo.angle);
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
