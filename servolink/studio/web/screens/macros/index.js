// Macros: course in time, tried on the figure before the robot moves.

import { html, useEffect, useMemo, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { PasteButton } from "../../parts/paste-button.js";
import { Reading } from "../../parts/reading.js";
import { RunHold } from "../../parts/run-hold.js";
import { FigureStage } from "../../parts/stage.js";
import { TryOnTwin, useVerdicts, VerdictMark } from "../../parts/twin.js";
import { ViewChoice } from "../../parts/view-choice.js";
import { figure } from "../../state/figure.js";
import { isRunning, pause, pose, runOnRobot, seek, time, togglePlay } from "../../state/macro-preview.js";
import { draft, isWritten } from "../../state/project.js";
import { mayEdit } from "../../state/robot.js";
import {
  addEmptyMacro,
  course,
  macro,
  nameOfMacro,
  secondsOfMacro,
  showMacro,
  startFromRobot,
} from "../../state/shown-macro.js";
import { bodyNow } from "../../state/twin.js";
import { chooseServo, chosen, views } from "../../state/view.js";
import { seconds, t } from "../../texts/text.js";
import { duplicate, moveChosen, removeChosen } from "./commands.js";
import { Inspector } from "./inspector.js";
import { Timeline } from "./timeline.js";

/** @typedef {import("../../state/records.js").Macro} Macro */
/** @typedef {import("../../shell/app.js").Tools} Tools */

const STEP = 0.01; // seconds

/** @param {Tools} tools */
export function MacrosScreen(tools) {
  useEffect(() => {
    startFromRobot();
    return pause;
  }, []);
  useVerdicts();
  useKeys({
    " ": togglePlay,
    Home: () => seek(0),
    ",": () => seek(time.value - STEP),
    ".": () => seek(time.value + STEP),
    "Control+d": duplicate,
    Delete: removeChosen,
    Backspace: removeChosen,
    "Alt+ArrowLeft": () => moveChosen(-1),
    "Alt+ArrowRight": () => moveChosen(1),
  });
  if (draft.value === null) return html`<${Reading} link=${tools.link} icon="macros" />`;
  if (draft.value.macros.length === 0) return html`<${NoMacros} />`;
  return html`<h1 class="sr">${t("screen.macros")}</h1>
    <div class="macs">
      <${MacroList} />
      <${StageCard} ...${tools} />
      <${Inspector} key=${macro.value?.macro_id} />
      <${Timeline} />
    </div>`;
}

const NoMacros = () => html`<div class="card empty">
  <${Icon} name="macros" />
  <h1>${t("macros.none")}</h1>
  <p>${t("macros.none_detail")}</p>
  ${
    mayEdit.value &&
    html`<div class="row wrap">
    <button class="btn pri" onClick=${addEmptyMacro}><${Icon} name="plus" />${t("macros.new")}</button>
    <a class="btn" href="#actions"><${Icon} name="actions" />${t("macros.make_actions")}</a>
    <${PasteButton} isWide />
  </div>`
  }
</div>`;

// All macros.

function MacroList() {
  const macros = draft.value?.macros ?? [],
    list = useRef(/** @type {HTMLElement | null} */ (null));
  useEffect(() => {
    list.current?.querySelector("[aria-pressed=true]")?.scrollIntoView({ block: "nearest", inline: "nearest" });
  }, [macro.value?.macro_id]);
  return html`<section class="card list" aria-label=${t("screen.macros")}>
    <header>
      <h2>${t("screen.macros")} <span class="mut num count">${macros.length}</span></h2>
      ${mayEdit.value && html`<button class="btn s ic" aria-label=${t("macros.new")} title=${t("macros.new")} onClick=${addEmptyMacro}><${Icon} name="plus" /></button><${PasteButton} />`}
    </header>
    <div class="mlist" ref=${list}>${macros.map(row)}</div>
  </section>`;
}

/** @param {Macro} one */
function row(one) {
  const takes = secondsOfMacro(one),
    time = takes === null ? t("macros.endless") : seconds(takes, 1);
  return html`<button key=${one.macro_id} class="mrow" aria-pressed=${String(one === macro.value)} onClick=${() => showMacro(one.macro_id)}>
    <span class="sid">${one.macro_id}</span>
    <span class="grow"><b class="ell">${nameOfMacro(one)}</b><small class="num">${t("macros.facts", { time, count: one.commands.length })}</small></span>
    <${VerdictMark} type="macro" id=${one.macro_id} />
  </button>`;
}

// The figure plays the macro; the robot does so while it is held.

/** @param {Tools} tools */
function StageCard({ motion }) {
  const scene = useMemo(() => ({ pose, body: bodyNow, chosen: () => chosen.value, onPick: chooseServo }), []);
  const isEmpty = course.value === null || course.value.isCut || course.value.turns.length === 0;
  const id = macro.value?.macro_id ?? 0,
    takes = macro.value && secondsOfMacro(macro.value);
  const stored = takes !== null && isWritten("macro", id) ? { type: "macro", id, seconds: takes } : null;
  return html`<section class="stage" aria-label=${t("macros.preview")}>
    ${figure.value && html`<${FigureStage} figure=${figure.value} scene=${scene} label=${t("macros.preview")} view=${views.macros.value} />`}
    <div class="tl col"><${ViewChoice} of="macros" /></div>
    <div class="tr">
      ${
        isRunning.value
          ? html`<span class="chip warn" role="status"><${Icon} name="live" />${t("macros.running")}</span>`
          : html`<span class="chip acc"><${Icon} name="eye" />${t("macros.preview_only")}</span>`
      }
    </div>
    <div class="bl col"><${TryOnTwin} type="macro" id=${id} /></div>
    <div class="br"><${RunHold} label=${t("macros.hold_to_run")} stored=${stored} disabled=${isEmpty} motion=${motion} onBegin=${() => runOnRobot(motion)} /></div>
  </section>`;
}
