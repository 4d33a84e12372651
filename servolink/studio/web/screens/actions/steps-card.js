// The action on the screen: its name, whether it is too fast, and every servo.

import { html } from "../../html.js";
import { Menu } from "../../parts/menu.js";
import { copyMotion } from "../../parts/paste.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { NameField } from "../../parts/typing.js";
import { speedsOf, tooFast } from "../../state/edit-action.js";
import { limbName, limbs, nameOf } from "../../state/figure.js";
import { capOf } from "../../state/limits.js";
import { fitCaption } from "../../state/records.js";
import { mayEdit } from "../../state/robot.js";
import { action, changeAction, ghostAction, nameOfAction, startPose } from "../../state/shown-action.js";
import { t } from "../../texts/text.js";
import { duplicate, moreTime, remove } from "./commands.js";
import { StepRow } from "./step-row.js";

const SHORTEST_BAR = 200; // milliseconds that fill a bar at least

/** Card with the steps of the action, one row for each servo. */
export function StepsCard() {
  const one = action.value;
  if (one === null) return null;
  const speeds = speedsOf(one, startPose(ghostAction.value));
  const longest = Math.max(SHORTEST_BAR, ...one.steps.map((step) => step.interval_ms));
  const byServo = new Map(one.steps.map((step) => [step.servo_id, step]));
  const shown = new Set(limbs.value.flatMap((limb) => limb.ids));
  const strangers = one.steps.map((step) => step.servo_id).filter((id) => !shown.has(id));
  const groups = strangers.length > 0 ? [...limbs.value, { limb: "?", ids: [...new Set(strangers)] }] : limbs.value;
  return html`<section class="card steps" aria-label=${nameOfAction(one)}>
    <header><${Name} />
      ${
        mayEdit.value &&
        html`<${Menu} label=${t("actions.more")} items=${[
          { label: t("actions.duplicate"), run: duplicate },
          { label: t("paste.copy"), run: () => copyMotion("action", one.action_id) },
          { label: t("actions.delete"), run: remove, danger: true },
        ]} />`
      }
    </header>
    <${Warning} />
    <div class="step titles" aria-hidden="true">
      <span></span><span></span><span>${t("actions.servo")}</span><span>${t("actions.target")}</span><span>${t("actions.time")}</span>
    </div>
    <div class="scroll">
      ${groups.map(
        ({
          limb,
          ids,
        }) => html`<div key=${`${one.action_id} ${limb}`} role="group" aria-label=${limbName(limb)} data-g=${limb}>
        <div class="grp" aria-hidden="true"><span class="gd"></span>${limb === "?" ? t("actions.strangers") : limbName(limb)}</div>
        ${ids.map((id) => html`<${StepRow} key=${id} id=${id} step=${byServo.get(id)} speed=${speeds.get(id) ?? 0} longest=${longest} />`)}
      </div>`,
      )}
    </div>
  </section>`;
}

function Name() {
  const one = action.value;
  if (one === null) return null;
  /** @param {string} name */
  const rename = (name) => {
    const action_caption = fitCaption(name);
    if (action_caption !== one.action_caption)
      changeAction("actions.did_rename", (each) => ({ ...each, action_caption }), {
        values: { to: safeText(action_caption) },
      });
    return action_caption;
  };
  return html`<${NameField} key=${one.action_id} name=${safeText(one.action_caption)} placeholder=${nameOfAction(one)} label=${t("actions.name")} onChange=${rename} />`;
}

function Warning() {
  const one = action.value;
  const fast = one === null ? [] : tooFast(one, startPose(ghostAction.value), capOf);
  if (fast.length === 0) return null;
  const speed = Math.max(...fast.map(([, each]) => each)),
    [first, second] = fast.map(([id]) => nameOf(id));
  const names =
    fast.length === 1
      ? first
      : fast.length === 2
        ? t("actions.both", { first, second })
        : t("actions.several", { first, count: fast.length - 1 });
  const from = ghostAction.value ? nameOfAction(ghostAction.value) : t("actions.ghost_robot");
  const values = { cap: Math.min(...fast.map(([id]) => capOf(id))), speed: Math.round(speed) };
  const detail = speed === Infinity ? t("actions.no_time") : t("actions.up_to", values);
  return html`<div class="slimbox"><${Note} kind="warn" slim title=${t("actions.too_fast_from", { names, from })} detail=${detail}>
    <button class="btn s" onClick=${moreTime}>${t("actions.more_time")}</button>
  </${Note}></div>`;
}
