// Playing the preview, adding commands, and how the timeline is shown.

import { html, useRef, useSignalEffect, useState } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { Segments } from "../../parts/segments.js";
import { t } from "../../texts/text.js";
import { AddDialog } from "./add-dialog.js";
import { course, insertCommand } from "../../state/shown-macro.js";
import { isLooping, isPlaying, seek, time, toggleLoop, togglePlay } from "../../state/macro-preview.js";
import { isFarthest, isNearest, lanes, showLanes, zoomIn, zoomOut } from "../../state/timeline.js";

const PAUSE = 500; // milliseconds of a new pause

export function TimelineBar() {
  const [adding, setAdding] = useState(/** @type {"action" | "macro" | null} */ (null));
  const playText = t(isPlaying.value ? "macros.pause_preview" : "macros.play");
  return html`<div class="tlbar" role="toolbar" aria-label=${t("macros.tools")}>
    <button class="btn ic" aria-label=${t("macros.to_start")} title=${t("macros.to_start")} onClick=${() => seek(0)}><${Icon} name="start" /></button>
    <button class="btn pri ic" aria-label=${playText} title=${playText} disabled=${!course.value?.seconds} onClick=${togglePlay}><${Icon} name=${isPlaying.value ? "pause" : "play"} /></button>
    <button class="btn ic hide-n" aria-label=${t("macros.loop")} title=${t("macros.loop")} aria-pressed=${String(isLooping.value)} onClick=${toggleLoop}><${Icon} name="loop" /></button>
    <${Clock} />
    <span class="grow"></span>
    <button class="btn s" aria-label=${t("macros.add_action")} onClick=${() => setAdding("action")}><${Icon} name="plus" />${t("macros.action")}</button>
    <button class="btn s" aria-label=${t("macros.add_pause")} onClick=${() => insertCommand("delay", PAUSE)}><${Icon} name="plus" />${t("macros.pause")}</button>
    <button class="btn s" aria-label=${t("macros.add_macro")} onClick=${() => setAdding("macro")}><${Icon} name="plus" />${t("macros.macro")}</button>
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
