// The commands of the macro as clips: they are dragged to another place, and at the right edge to another speed.

import { html, useEffect, useLayoutEffect, useRef } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { PosePicture } from "../../parts/pose-picture.js";
import { takesFocus } from "../../state/focus.js";
import { draft, settle } from "../../state/project.js";
import { poseOf } from "../../state/records.js";
import { chooseClip, chosenClip, course, macro, nameOfCommand } from "../../state/shown-macro.js";
import {
  dragClip,
  dragged,
  endDrag,
  freezeScale,
  handles,
  measureLane,
  place,
  releaseScale,
  share,
  span,
} from "../../state/timeline.js";
import { seconds, t } from "../../texts/text.js";
import { move, stretch } from "./commands.js";

/** @typedef {import("../../state/macro-time.js").Clip} Clip */

const THRESHOLD = 4; // pixels before a press becomes a drag
const PICTURE = 0.07,
  TIME = 0.028; // share of the timeline from which picture or time fit a clip
const MOST_MARKS = 50;

/** Lane of clips, one for each command of the macro. */
export function ClipsLane() {
  const lane = useRef(/** @type {HTMLElement | null} */ (null));
  useLayoutEffect(() => {
    const element = /** @type {HTMLElement} */ (lane.current);
    measureLane(element.clientWidth);
    const size = new ResizeObserver(() => measureLane(element.clientWidth));
    size.observe(element);
    return () => size.disconnect();
  }, []);
  useEffect(() => {
    if (takesFocus("clip"))
      /** @type {HTMLElement | null} */ (lane.current?.querySelector("[aria-pressed=true]"))?.focus();
  });
  const all = (course.value?.clips ?? []).filter((clip) => clip.depth === 0);
  return html`<div class=${handles.value.size > 0 ? "bd numbered" : "bd"} ref=${lane}>
    <${Leads} />
    ${all.map((clip) => html`<${TopClip} key=${clip.index} clip=${clip} all=${all} />`)}
    <${Gap} all=${all} />
    ${all.length === 0 && html`<span class="quiet">${course.value === null ? t("macros.endless_detail") : t("macros.empty")}</span>`}
  </div>`;
}

/**
 * Where the dragged clip falls if it is dropped now.
 * @param {{ all: Clip[] }} props
 */
function Gap({ all }) {
  if (dragged.value === null) return null;
  const { index, to } = dragged.value,
    others = all.filter((clip) => clip.index !== index);
  return html`<i class="drop" style=${{ left: share(others[to]?.from ?? others.at(-1)?.until ?? 0) }}></i>`;
}

/** Lines from the short clips to the numbers below. */
function Leads() {
  if (handles.value.size === 0) return null;
  const lines = [...handles.value.values()].map(({ from, to }) => `M${from.toFixed(1)} 0L${to.toFixed(1)} 8`);
  return html`<svg class="leads" aria-hidden="true"><path d=${lines.join("")} /></svg>`;
}

/** @param {{ clip: Clip, all: Clip[] }} props */
function TopClip({ clip, all }) {
  const { command, index } = clip,
    marks = command.loop > 1 ? Math.min(MOST_MARKS, command.loop) - 1 : 0;
  const handlers = useReorder(clip, all),
    what = nameOfCommand(command);
  const label = t("macros.clip_aria", { what, time: seconds(clip.from, 1), seconds: seconds(clip.until - clip.from) });
  const isChosen = index === chosenClip.value,
    handle = handles.value.get(index);
  const face = html`${Array.from({ length: marks }, (_, at) => html`<i class="rep" style=${{ left: `${((at + 1) / (marks + 1)) * 100}%` }}></i>`)}
    <${ClipLabel} clip=${clip} />
    <${Edge} clip=${clip} />`;
  const choose = () => chooseClip(index);
  if (handle === undefined)
    return html`<button class="clip ${command.type}" style=${place(clip)} aria-pressed=${String(isChosen)} title=${label} onClick=${choose} onFocus=${choose} ...${handlers}>${face}</button>`;
  return html`<div class="clip ${command.type} ${isChosen ? "on" : ""}" style=${place(clip)} title=${label} aria-hidden="true" onClick=${choose} ...${handlers}>${face}</div>
    <button class="clipno num" style=${{ left: `${handle.to}px` }} aria-pressed=${String(isChosen)} aria-label=${`${index + 1}: ${label}`} title=${label} onClick=${choose} onFocus=${choose} ...${handlers}>${index + 1}</button>`;
}

/** @param {{ clip: Clip }} props */
function ClipLabel({ clip: { command, depth, from, until } }) {
  const part = (until - from) / span.value;
  if (command.type === "delay")
    return html`<span class="sr">${t("macros.pause")} </span>${part > TIME && html`<span>${seconds(until - from, 1)}</span>`}`;
  const action =
    command.type === "action" &&
    depth === 0 &&
    part > PICTURE &&
    draft.value?.actions.find((one) => one.action_id === command.action_id);
  return html`${action && html`<${PosePicture} pose=${poseOf(action)} distance=${0.9} />`}
    ${command.type === "macro" && html`<${Icon} name="macros" />`}
    <span class="ell">${nameOfCommand(command)}</span>
    ${command.ratio_percent !== 100 && html`<span class="tag">${command.ratio_percent} %</span>`}
    ${command.loop > 1 && html`<span class="tag">×${command.loop}</span>`}`;
}

/** @param {{ clip: Clip }} props */
function Edge({ clip }) {
  const grip = useRef(/** @type {{ x: number, perPixel: number, clip: Clip } | null} */ (null));
  /** @param {PointerEvent} event */
  const grab = (event) => {
    event.stopPropagation();
    const edge = /** @type {HTMLElement} */ (event.currentTarget);
    edge.setPointerCapture(event.pointerId);
    chooseClip(clip.index);
    freezeScale();
    grip.current = { x: event.clientX, perPixel: span.value / (edge.closest(".bd")?.clientWidth ?? 1), clip };
  };
  /** @param {PointerEvent} event */
  const pull = (event) => {
    if (grip.current === null) return;
    const { x, perPixel, clip: before } = grip.current;
    stretch(before.index, before, before.command, before.until - before.from + (event.clientX - x) * perPixel);
  };
  const release = () => {
    if (grip.current === null) return;
    grip.current = null;
    releaseScale();
    settle();
  };
  useEffect(() => release, []); // another page may delete the clip under the pointer
  return html`<span class="edge" onPointerDown=${grab} onPointerMove=${pull} onPointerUp=${release} onPointerCancel=${release} onLostPointerCapture=${release}></span>`;
}

/**
 * Return the handlers that drag a clip to another place. Each movement draws only the dragged clip again: there may be a
 * thousand.
 * @param {Clip} clip
 * @param {Clip[]} all
 */
function useReorder(clip, all) {
  const grip = useRef(/** @type {{ x: number, perPixel: number, element: HTMLElement } | null} */ (null));
  /** @param {PointerEvent} event */
  const grab = (event) => {
    if (event.button !== 0) return;
    const element = /** @type {HTMLElement} */ (event.currentTarget);
    grip.current = { x: event.clientX, perPixel: span.value / (element.closest(".bd")?.clientWidth ?? 1), element };
    element.setPointerCapture(event.pointerId);
  };
  /** @param {PointerEvent} event */
  const pull = (event) => {
    if (grip.current === null) return;
    const { x, perPixel, element } = grip.current,
      by = event.clientX - x;
    if (dragged.value === null && Math.abs(by) < THRESHOLD) return;
    element.classList.add("drag");
    element.style.transform = `translateX(${by}px)`;
    const middle = (clip.from + clip.until) / 2 + by * perPixel;
    const to = all.filter((other) => other !== clip && (other.from + other.until) / 2 < middle).length;
    dragClip(clip.index, to);
  };
  const cancel = () => {
    grip.current?.element.classList.remove("drag");
    grip.current?.element.style.removeProperty("transform");
    grip.current = null;
    return endDrag();
  };
  useEffect(() => () => grip.current && cancel(), []);
  const drop = () => {
    const drag = cancel();
    if (drag?.index === clip.index) move(drag.index, drag.to);
  };
  return { onPointerDown: grab, onPointerMove: pull, onPointerUp: drop, onPointerCancel: cancel };
}

/** Commands of the macros in the macro, one lane for each depth. */
export function InnerLanes() {
  const inner = (course.value?.clips ?? []).filter((clip) => clip.depth > 0);
  const depths = [...new Set(inner.map((clip) => clip.depth))].sort((a, b) => a - b);
  const names = [
    ...new Set((macro.value?.commands ?? []).filter((command) => command.type === "macro").map(nameOfCommand)),
  ].join(", ");
  return depths.map(
    (depth) => html`<div class="lane sub" key=${depth}>
    <div class="lb" title=${names}><${Icon} name="down" /><span class="ell">${depth === 1 ? names : t("macros.inside")}</span></div>
    <div class="bd" aria-hidden="true">
      ${inner.filter((clip) => clip.depth === depth).map((clip) => html`<div class="clip ${clip.command.type} ${clip.isAgain ? "again" : ""}" style=${place(clip)}><${ClipLabel} clip=${clip} /></div>`)}
    </div>
  </div>`,
  );
}
