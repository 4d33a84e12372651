// Teach: limbs go limp, are posed by hand, and each pose that is taken becomes an action.

import { html, useEffect, useRef, useSignalEffect } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { heard } from "../../state/button-events.js";
import { open } from "../../state/project.js";
import { isLive, servoIds } from "../../state/robot.js";
import { endPreview, forgetLast, holdAgain, isLimp, takePose } from "../../state/teaching.js";
import { t } from "../../texts/text.js";
import { Film } from "./film.js";
import { StageCard } from "./stage-card.js";
import { Steps } from "./steps.js";

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

/** Any button of the robot takes a pose; a long press, which has begun as a press, forgets that one and ends. */
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
