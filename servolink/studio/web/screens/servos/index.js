// Servos: finds a servo, and sets its name, correction, limits and direction.

import { html, useEffect, useRef, useSignalEffect } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Reading } from "../../parts/reading.js";
import { FigureStage } from "../../parts/stage.js";
import { figure, limbOf, nameOf } from "../../state/figure.js";
import { differences, draft } from "../../state/project.js";
import { actualPose, isLive, servoIds, servos } from "../../state/robot.js";
import { isFinding, leaveSetup, parameterOf, shownServo, toggleFinding } from "../../state/servo-setup.js";
import { chooseServo } from "../../state/view.js";
import { degrees, t } from "../../texts/text.js";
import { LimitsCard } from "./limits.js";
import { NameCard } from "./name.js";
import { TrimCard } from "./trim.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

/** @param {Tools} tools */
export function ServosScreen(tools) {
  const id = shownServo.value;
  useEffect(() => leaveSetup, []);
  if (draft.value === null) return html`<${Reading} link=${tools.link} icon="grid" />`;
  if (id === undefined)
    return html`<div class="card empty"><h1>${t("live.no_servos")}</h1><p>${t("live.no_servos_detail")}</p></div>`;
  const scene = { pose: actualPose, chosen: () => shownServo.value ?? null, onPick: chooseServo };
  return html`<h1 class="sr">${t("screen.servos")}</h1>
    <div class="servos">
      <${ServoList} shown=${id} />
      <section class="stage" aria-label=${t("servos.stage")}>
        ${figure.value ? html`<${FigureStage} figure=${figure.value} scene=${scene} label=${t("live.figure_aria")} />` : html`<div class="nofigure"><p class="mut">${t("figure.none")}</p></div>`}
      </section>
      <div class="setup" key=${id}>
        <${NameCard} id=${id} ...${tools} />
        <${TrimCard} id=${id} ...${tools} />
        <${LimitsCard} id=${id} ...${tools} />
        <${Unwritten} />
      </div>
    </div>`;
}

/** @param {{ shown: number }} props */
function ServoList({ shown }) {
  const list = useRef(/** @type {HTMLElement | null} */ (null));
  useSignalEffect(() => {
    for (const [id, servo] of servos.value) {
      const place = list.current?.querySelector(`[data-servo="${id}"]`);
      if (place) place.textContent = degrees(servo.angle);
    }
  });
  useEffect(() => {
    list.current?.querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }, [shown]);
  return html`<section class="card list" aria-label=${t("screen.servos")}>
    <header class="wrap"><h2>${t("screen.servos")} <span class="mut num count">${servoIds.value.length}</span></h2>
      <button class="btn s" aria-pressed=${String(isFinding.value)} disabled=${!isLive.value} onClick=${toggleFinding}>
        <${Icon} name="search" />${t("servos.find")}
      </button>
    </header>
    ${isFinding.value && html`<p class="pad0 mut" role="status">${t("servos.find_hint")}</p>`}
    <div class="mlist" ref=${list}>
      ${servoIds.value.map((id) => {
        const { adjusted_degree: trim } = parameterOf(id);
        return html`<button key=${id} class="mrow" data-g=${limbOf(id)} aria-pressed=${String(id === shown)} onClick=${() => chooseServo(id)}>
          <span class="sid">${id}</span>
          <span class="grow"><b class="ell">${nameOf(id)}</b><small class="num">${trim === 0 ? t("servos.no_trim") : t("servos.trimmed", { trim: signed(trim) })}</small></span>
          <span class="num" data-servo=${id}></span>
        </button>`;
      })}
    </div>
  </section>`;
}

function Unwritten() {
  const count = differences.value.filter(({ kind }) => kind === "servo_parameters").length;
  if (count === 0) return null;
  return html`<p class="row wrap unwritten"><span>${t("servos.unwritten", { count })}</span>
    <a class="btn s pri" href="#project">${t("settings.to_write")}</a></p>`;
}

/**
 * Return degrees with their sign.
 * @param {number} angle
 */
export const signed = (angle) => (angle > 0 ? `+${degrees(angle)}` : degrees(angle));
