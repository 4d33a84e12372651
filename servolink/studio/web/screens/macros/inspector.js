// The chosen command, or the macro as a whole, and whether anything is too fast.

import { html } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Menu } from "../../parts/menu.js";
import { Note } from "../../parts/note.js";
import { NumberField } from "../../parts/number-field.js";
import { copyMotion } from "../../parts/paste.js";
import { safeText } from "../../parts/safe-text.js";
import { NameField } from "../../parts/typing.js";
import { nameOf } from "../../state/figure.js";
import { capOf } from "../../state/limits.js";
import { draft, settle } from "../../state/project.js";
import { fitCaption } from "../../state/records.js";
import { mayEdit } from "../../state/robot.js";
import {
  changeMacro,
  chosenClip,
  course,
  fastTurns,
  macro,
  nameOfCommand,
  nameOfMacro,
  secondsOfMacro,
  showMacro,
} from "../../state/shown-macro.js";
import { list, seconds, t } from "../../texts/text.js";
import {
  chosenCommand,
  duplicate,
  duplicateMacro,
  FASTEST,
  MOST_REPEATS,
  moveChosen,
  removeChosen,
  removeMacro,
  setPause,
  setRepeats,
  setSpeed,
  SLOWEST,
} from "./commands.js";

/** @typedef {import("../../state/records.js").Command} Command */

const LONGEST_PAUSE = 0x7fff_ffff / 1000; // seconds

/** Fields of the chosen command of the macro. */
export function Inspector() {
  const command = chosenCommand();
  return html`<section class="card insp">
    <${Whole} />
    ${command !== null && mayEdit.value && html`<${One} command=${command} at=${chosenClip.value} />`}
    <div class="pad0"><${Speeds} /></div>
  </section>`;
}

function Whole() {
  const one = macro.value;
  if (one === null) return null;
  /** @param {string} name */
  const rename = (name) => {
    const macro_caption = fitCaption(name);
    if (macro_caption !== one.macro_caption)
      changeMacro("macros.did_rename", (each) => ({ ...each, macro_caption }), {
        values: { to: safeText(macro_caption) },
      });
    return macro_caption;
  };
  const takes = secondsOfMacro(one),
    time = takes === null ? t("macros.endless") : seconds(takes);
  return html`<header>
      <${NameField} name=${safeText(one.macro_caption)} placeholder=${nameOfMacro(one)} label=${t("actions.name")} onChange=${rename} />
      ${
        mayEdit.value &&
        html`<${Menu} label=${t("actions.more")} items=${[
          { label: t("actions.duplicate"), run: duplicateMacro },
          { label: t("paste.copy"), run: () => copyMotion("macro", one.macro_id) },
          { label: t("actions.delete"), run: removeMacro, danger: true },
        ]} />`
      }
    </header>
    <p class="pad0 mut num">${t("macros.facts", { time, count: one.commands.length })}</p>`;
}

/** @param {{ command: Command, at: number }} props */
function One({ command, at }) {
  const clip = course.value?.clips.find((each) => each.depth === 0 && each.index === at),
    isPause = command.type === "delay";
  const called =
    command.type === "macro" ? draft.value?.macros.find((each) => each.macro_id === command.macro_id) : undefined;
  /** @param {Event} event */
  const slide = (event) => setSpeed(at, Number(/** @type {HTMLInputElement} */ (event.currentTarget).value), "slide");
  return html`<header class="part">
      <h2 class="ell">${nameOfCommand(command)}</h2>
      <span class=${command.type === "macro" ? "chip acc" : "chip"}>${t(`kind.${command.type}`)}</span>
      <${Menu} label=${t("macros.more")} items=${[
        { label: t("macros.earlier"), run: () => moveChosen(-1) },
        { label: t("macros.later"), run: () => moveChosen(1) },
        { label: t("actions.duplicate"), run: duplicate },
        { label: t("actions.delete"), run: removeChosen, danger: true },
      ]} />
    </header>
    <div class="pad0 fields">
      ${
        isPause &&
        html`<label class="field"><span>${t("macros.waits")}</span>
        <${NumberField} value=${(command.delay_ms ?? 0) / 1000} format=${seconds} step=${0.01} low=${0} high=${LONGEST_PAUSE} label=${t("macros.waits")} onChange=${(/** @type {number} */ time) => setPause(at, time * 1000)} />
      </label>`
      }
      <label class="field"><span class="row"><span class="grow">${t("macros.speed")}</span><b class="num">${command.ratio_percent} %</b></span>
        <input type="range" min=${SLOWEST} max=${FASTEST} value=${command.ratio_percent} aria-label=${t("macros.speed")} onInput=${slide} onChange=${settle} />
      </label>
      <div class="row">
        <label class="field grow"><span>${t("macros.repeat")}</span>
          <${NumberField} value=${command.loop} format=${times} low=${1} high=${MOST_REPEATS} label=${t("macros.repeat")} onChange=${(/** @type {number} */ loop) => setRepeats(at, loop)} />
        </label>
        <label class="field grow"><span>${t("macros.takes")}</span>
          <input class="inp num" readonly value=${seconds(clip ? clip.until - clip.from : 0)} />
        </label>
      </div>
      ${
        called &&
        html`<p class="mut does">${t("macros.does", {
          list: list(called.commands.filter((each) => each.type !== "delay").map(nameOfCommand)),
        })}</p>
        <button class="btn s" onClick=${() => showMacro(called.macro_id)}>${t("macros.open", { name: nameOfMacro(called) })}<${Icon} name="arrow" /></button>`
      }
    </div>`;
}

function Speeds() {
  const whole = course.value,
    fast = fastTurns.value;
  if (whole === null)
    return html`<${Note} kind="warn" title=${t("macros.endless")} detail=${t("macros.endless_detail")} />`;
  if (whole.isCut) return html`<${Note} kind="info" title=${t("macros.cut")} />`;
  if (whole.turns.length === 0) return html`<${Note} kind="info" title=${t("macros.empty")} />`;
  if (fast.length === 0) {
    const cap = Math.min(...whole.turns.map((turn) => capOf(turn.servoId)));
    return html`<${Note} kind="ok" title=${t("macros.slow_enough")} detail=${t("macros.checked_at", { cap })} />`;
  }
  const [first] = fast,
    cap = Math.min(...fast.map((turn) => capOf(turn.servoId)));
  const detail = t("macros.fast_detail", { servo: nameOf(first.servoId), time: seconds(first.from, 1) });
  return html`<${Note} kind="warn" title=${t("macros.fast", { count: fast.length, cap })} detail=${detail} />`;
}

/** @param {number} count */
const times = (count) => `${count} ×`;
