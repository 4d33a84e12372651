// Name, state and direction of a servo.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { LetGoButton } from "../../parts/let-go-button.js";
import { safeText } from "../../parts/safe-text.js";
import { NameField } from "../../parts/typing.js";
import { figure, limbOf, saveFigure } from "../../state/figure.js";
import { changed } from "../../state/fitting.js";
import { captions, isLive, isLocalEditor, isOthers, mayMove, servoIds } from "../../state/robot.js";
import { nameServo, parameterOf } from "../../state/servo-setup.js";
import { toast } from "../../state/toasts.js";
import { t } from "../../texts/text.js";
import { Wiggle } from "../board/fit-steps.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {{ id: number } & Tools} props */
export function NameCard({ id, link, motion }) {
  const caption = parameterOf(id).servo_caption;
  const isTwice =
    caption !== "" && servoIds.value.some((other) => other !== id && parameterOf(other).servo_caption === caption);
  return html`<section class="card" data-g=${limbOf(id)} aria-label=${t("servos.name_of", { id })}>
    <header><span class="sid">${id}</span>
      <${NameField} name=${safeText(caption)} placeholder=${t("live.servo", { id })} label=${t("servos.name")} onChange=${(/** @type {string} */ name) => nameServo(id, name)} />
    </header>
    <div class="pad0 stack">
      ${isTwice && html`<p class="mut" role="status">${t("servos.name_twice")}</p>`}
      ${captions.value[id] !== caption && html`<p class="mut">${t("servos.name_was", { name: safeText(captions.value[id] ?? "") || t("live.servo", { id }) })}</p>`}
      <div class="row wrap"><${Wiggle} key=${id} servo=${id} motion=${motion} /></div>
      <p class="mut">${t("figure.wiggle_hint")}</p>
      <${Hands} id=${id} link=${link} />
      <${Direction} id=${id} link=${link} />
    </div>
  </section>`;
}

/**
 * Buttons to release a servo, so that a hand can move it, and to hold it again.
 * @param {{ id: number, link: import("../../link/link.js").Link }} props
 */
export function Hands({ id, link }) {
  /** @param {boolean} isHeld */
  const set = (isHeld) =>
    link
      .call("servo.set", { servo: id, start: isHeld, hold: isHeld })
      .catch((error) => toast({ kind: "bad", title: safeText(error.message) }));
  const isOff = !isLive.value || !mayMove.value || isOthers.value;
  return html`<div class="row wrap">
    <${LetGoButton} id=${id} disabled=${isOff} onYes=${() => set(false)} />
    <button class="btn s" disabled=${isOff} onClick=${() => set(true)}><${Icon} name="hand" />${t("servos.hold")}</button>
  </div>`;
}

/** @param {{ id: number, link: import("../../link/link.js").Link }} props */
function Direction({ id, link }) {
  const joint = figure.value?.byServo.get(id);
  if (!joint || figure.value === null || !isLocalEditor.value) return null;
  const data = figure.value.data;
  const turn = () =>
    saveFigure(link, changed({ data, parts: [] }, joint.id, { sign: joint.sign === -1 ? 1 : -1 }).data).then(
      () => toast({ kind: "ok", title: t("servos.turned") }),
      (error) => toast({ kind: "bad", title: safeText(error.message) }),
    );
  return html`<div class="row wrap"><span class="grow">${t("servos.direction")}</span>
    <button class="btn s" onClick=${turn}><${Icon} name="mirror" />${t("servos.turn_round")}</button></div>
    <p class="mut">${t("servos.direction_hint")}</p>`;
}
