// What the macro does in time: clips, what is inside them, and every servo that moves.

import { computed, html, useRef, useSignalEffect } from "../../html.js";
import { nameOf } from "../../state/figure.js";
import { servoIds } from "../../state/robot.js";
import { seconds, t } from "../../texts/text.js";
import { ClipsLane, InnerLanes } from "./clips.js";
import { chooseClip, chosenClip, course, macro, nameOfMacro } from "../../state/shown-macro.js";
import { LimbLanes, movedServos, ServoLanes } from "./lanes.js";
import { seek, time } from "../../state/macro-preview.js";
import { lanes, share, span, zoom } from "../../state/timeline.js";
import { TimelineBar } from "./timeline-bar.js";

const MOST_TICKS = 14;
const MOST_RIGHT = 0.98; // share of the timeline where the last one still has room
const TICKS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 600, 3600]; // seconds

const ticks = computed(() => {
  const step = TICKS.find((each) => span.value / each <= MOST_TICKS * zoom.value) ?? span.value;
  return Array.from({ length: Math.ceil((span.value * MOST_RIGHT) / step) }, (_, at) => at * step);
});

export function Timeline() {
  return html`<section class="card tl">
    <${TimelineBar} />
    <div class="tlgrid" tabindex="0" role="region" aria-label=${t("macros.timeline")}>
      <div class="tlin" style=${{ minWidth: `max(var(--least-timeline), ${zoom.value * 100}%)` }}>
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
  return html`<div class="quiet" title=${still.map(nameOf).join(", ")}>${t("macros.quiet", { count: still.length })}</div>`;
}
