// Course of the macro in time: clips, the commands inside them, and every servo that moves.

import { computed, html, useRef, useSignalEffect, useState } from "../../html.js";
import { Dialog } from "../../parts/dialog.js";
import { Icon } from "../../parts/icon.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { safeText } from "../../parts/safe-text.js";
import { Segments } from "../../parts/segments.js";
import { callable } from "../../state/edit-macro.js";
import { nameOf } from "../../state/figure.js";
import { isLooping, isPlaying, seek, time, toggleLoop, togglePlay } from "../../state/macro-preview.js";
import { draft } from "../../state/project.js";
import { poseOf } from "../../state/records.js";
import { mayEdit, servoIds } from "../../state/robot.js";
import { chooseClip, chosenClip, course, insertCommand, macro, nameOfMacro } from "../../state/shown-macro.js";
import {
  isFarthest,
  isNearest,
  lanes,
  leastWidth,
  share,
  showLanes,
  span,
  zoom,
  zoomIn,
  zoomOut,
} from "../../state/timeline.js";
import { list, seconds, t } from "../../texts/text.js";
import { ClipsLane, InnerLanes } from "./clips.js";
import { LimbLanes, movedServos, ServoLanes } from "./lanes.js";

const MOST_TICKS = 14;
const MOST_RIGHT = 0.98; // share of the timeline where the last one still has room
const TICKS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 600, 3600]; // seconds

const ticks = computed(() => {
  const step = TICKS.find((each) => span.value / each <= MOST_TICKS * zoom.value) ?? span.value;
  return Array.from({ length: Math.ceil((span.value * MOST_RIGHT) / step) }, (_, at) => at * step);
});

/** Time axis of the macro with clips, lanes and playhead. */
export function Timeline() {
  return html`<section class="card tl">
    <${TimelineBar} />
    <div class="tlgrid" tabindex="0" role="region" aria-label=${t("macros.timeline")}>
      <div class="tlin" style=${{ minWidth: `max(var(--least-timeline), ${zoom.value * 100}%, calc(var(--lane-label) + ${leastWidth.value}px))` }}>
        <${Ruler} />
        <div class="lane clips">
          <button class="lb plain" aria-pressed=${String(chosenClip.value === null)} onClick=${() => chooseClip(null)}>
            <b class="ell">${macro.value && nameOfMacro(macro.value)}</b>
          </button>
          <${ClipsLane} key=${macro.value?.macro_id} />
        </div>
        <${InnerLanes} />
        ${lanes.value === "servos" ? html`<${ServoLanes} />` : html`<${LimbLanes} />`}
        <${Quiet} />
        <div class="phwrap"><${Playhead} /></div>
      </div>
    </div>
  </section>`;
}

function Ruler() {
  const isHeld = useRef(false);
  /** @param {PointerEvent} event */
  const go = (event) => {
    const { left, width } = /** @type {Element} */ (event.currentTarget).getBoundingClientRect();
    seek(((event.clientX - left) / width) * span.value);
  };
  /** @param {PointerEvent} event */
  const grab = (event) => {
    /** @type {Element} */ (event.currentTarget).setPointerCapture(event.pointerId);
    isHeld.current = true;
    go(event);
  };
  /** @param {PointerEvent} event */
  const pull = (event) => isHeld.current && go(event);
  const release = () => (isHeld.current = false);
  /** @param {KeyboardEvent} event */
  const press = (event) => {
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (way === undefined || event.altKey) return;
    event.preventDefault();
    seek(time.value + way * (event.shiftKey ? 0.1 : 0.01));
  };
  const now = Math.round(time.value * 100) / 100;
  return html`<div class="lane ruler">
    <div class="lb"></div>
    <div class="bd" role="slider" tabindex="0" aria-label=${t("macros.position")} aria-valuemin="0" aria-valuemax=${course.value?.seconds ?? 0}
      aria-valuenow=${now} aria-valuetext=${seconds(now)} onPointerDown=${grab} onPointerMove=${pull} onPointerUp=${release} onLostPointerCapture=${release} onKeyDown=${press}>
      ${ticks.value.map((tick) => html`<span style=${{ left: share(tick) }}>${Number(tick.toFixed(1))} s</span>`)}
    </div>
  </div>`;
}

function Playhead() {
  const head = useRef(/** @type {HTMLElement | null} */ (null));
  useSignalEffect(() => {
    const left = share(time.value);
    if (head.current) head.current.style.left = left;
  });
  return html`<div class="ph" ref=${head}></div>`;
}

function Quiet() {
  const still = servoIds.value.filter((id) => !movedServos.value.includes(id));
  if (still.length === 0) return null;
  return html`<div class="quiet" title=${list(still.map(nameOf))}>${t("macros.quiet", { count: still.length })}</div>`;
}

// Playing the preview, adding commands, and how the timeline is shown.

const PAUSE = 500; // milliseconds of a new pause

function TimelineBar() {
  const [adding, setAdding] = useState(/** @type {"action" | "macro" | null} */ (null));
  const playText = t(isPlaying.value ? "macros.pause_preview" : "macros.play");
  return html`<div class="tlbar" role="toolbar" aria-label=${t("macros.tools")}>
    <button class="btn ic" aria-label=${t("macros.to_start")} title=${t("macros.to_start")} onClick=${() => seek(0)}><${Icon} name="start" /></button>
    <button class="btn pri ic" aria-label=${playText} title=${playText} disabled=${!course.value?.seconds} onClick=${togglePlay}><${Icon} name=${isPlaying.value ? "pause" : "play"} /></button>
    <button class="btn ic hide-n" aria-label=${t("macros.loop")} title=${t("macros.loop")} aria-pressed=${String(isLooping.value)} onClick=${toggleLoop}><${Icon} name="loop" /></button>
    <${Clock} />
    <span class="grow"></span>
    ${
      mayEdit.value &&
      html`<button class="btn s" aria-label=${t("macros.add_action")} onClick=${() => setAdding("action")}><${Icon} name="plus" />${t("macros.action")}</button>
    <button class="btn s" aria-label=${t("macros.add_pause")} onClick=${() => insertCommand("delay", PAUSE)}><${Icon} name="plus" />${t("macros.pause")}</button>
    <button class="btn s" aria-label=${t("macros.add_macro")} onClick=${() => setAdding("macro")}><${Icon} name="plus" />${t("macros.macro")}</button>`
    }
    <span class="rule hide-n"></span>
    <div class="hide-t hide-n"><${Segments} label=${t("macros.lanes")} small value=${lanes.value} onChoose=${showLanes}
      choices=${[
        { value: "servos", label: t("macros.servos") },
        { value: "limbs", label: t("macros.limbs") },
      ]} /></div>
    <button class="btn s ic hide-n" aria-label=${t("macros.zoom_out")} title=${t("macros.zoom_out")} disabled=${isFarthest.value} onClick=${zoomOut}><${Icon} name="zoom-out" /></button>
    <button class="btn s ic hide-n" aria-label=${t("macros.zoom_in")} title=${t("macros.zoom_in")} disabled=${isNearest.value} onClick=${zoomIn}><${Icon} name="zoom" /></button>
    ${adding && html`<${AddDialog} type=${adding} onClose=${() => setAdding(null)} />`}
  </div>`;
}

function Clock() {
  const now = useRef(/** @type {HTMLElement | null} */ (null));
  useSignalEffect(() => {
    const text = time.value.toFixed(2);
    if (now.current) now.current.textContent = text;
  });
  return html`<div class="time"><span ref=${now}></span> <small>/ ${(course.value?.seconds ?? 0).toFixed(2)} s</small></div>`;
}

// Chooses the action or the macro to add.

/** @param {{ type: "action" | "macro", onClose: () => void }} props */
function AddDialog({ type, onClose }) {
  const actions = draft.value?.actions ?? [];
  const macros = draft.value && macro.value ? callable(draft.value, macro.value) : [];
  const count = type === "action" ? actions.length : macros.length;
  /** @param {number} id */
  const choose = (id) => {
    onClose();
    insertCommand(type, id);
  };
  return html`<${Dialog} title=${t(type === "action" ? "macros.add_action" : "macros.add_macro")} onClose=${onClose}>
    ${count === 0 && html`<p class="mut">${t("macros.nothing_to_add")}</p>`}
    ${
      type === "action"
        ? html`<div class="poses wide">${actions.map(
            (one) => html`<button class="pose" onClick=${() => choose(one.action_id)}>
          <${PosePicture} pose=${poseOf(one)} /><div><b class="ell">${safeText(one.action_caption) || t("actions.unnamed", { id: one.action_id })}</b></div>
        </button>`,
          )}</div>`
        : macros.map(
            (one) =>
              html`<button class="mrow" onClick=${() => choose(one.macro_id)}><span class="sid">${one.macro_id}</span><b class="ell">${nameOfMacro(one)}</b></button>`,
          )
    }
  </${Dialog}>`;
}
