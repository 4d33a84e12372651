// Record: a file of all events, and three plots of the servos on a common time axis.

import { html, useEffect } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { Menu } from "../../parts/menu.js";
import { Plot } from "../../parts/plot.js";
import { limbName, limbOf, limbs, nameOf } from "../../state/figure.js";
import { open } from "../../state/project.js";
import {
  freeze,
  frozen,
  mark,
  marks,
  mayRecord,
  mayRun,
  plotServos,
  plotted,
  refresh,
  startOrStop,
  status,
} from "../../state/recording.js";
import { history, isLive, servoIds, servos } from "../../state/robot.js";
import { theme } from "../../state/settings.js";
import { chosen } from "../../state/view.js";
import { number, t } from "../../texts/text.js";
import { makeActions, saveRecording, saveTable } from "./export.js";

/** @typedef {import("../../shell/app.js").Tools} Tools */

const SECONDS = 30;
const LOOK_EVERY = 1000; // milliseconds between two looks at the file
/** @type {{ quantity: import("../../state/history.js").Quantity, title: import("../../texts/text.js").Key, unit: string }[]} */
const PLOTS = [
  { quantity: "angle", title: "live.angle", unit: "°" },
  { quantity: "current_raw", title: "live.current_title", unit: "" },
  { quantity: "temperature_raw", title: "live.temperature_title", unit: "" },
];

/** @param {Tools} tools */
export function RecordScreen({ link }) {
  useEffect(() => {
    if (isLive.value) open(link); // the names that are taken already
    refresh(link);
    link.on("recording", () => refresh(link));
    const timer = setInterval(() => status.value?.is_recording && !document.hidden && refresh(link), LOOK_EVERY);
    return () => clearInterval(timer);
  }, [isLive.value]);
  useKeys({
    f: (event) => event.repeat || freeze(),
    k: (event) => event.repeat || mark(link),
    r: (event) => event.repeat || !mayRecord.value || startOrStop(link),
  });
  const shown = frozen.value ?? history;
  return html`<div class=${isLive.value ? "rec" : "rec stale"}>
    <section class="card plots">
      <${Head} link=${link} />
      ${PLOTS.map(
        ({ quantity, title, unit }) => html`<div class="p" key=${quantity}>
        <h2>${t(title)}</h2>
        <${Plot} history=${shown} ids=${plotted.value} quantity=${quantity} seconds=${SECONDS} chosen=${plotted.value.includes(chosen.value ?? -1) ? chosen.value : null}
          limbOf=${limbOf} unit=${unit} label=${t(title)} nowLabel=${frozen.value ? "0 s" : t("live.now")} look=${theme.value} marks=${marks} />
      </div>`,
      )}
    </section>
    <${ServoList} />
  </div>`;
}

/** @param {{ link: import("../../link/link.js").Link }} props */
function Head({ link }) {
  const now = status.value,
    isRecording = now?.is_recording ?? false;
  const label = isRecording ? t("record.stop") : t("record.start");
  return html`<header class="wrap">
    ${mayRun.value && html`<button class="recbtn" aria-pressed=${String(isRecording)} aria-label=${label} title=${label} disabled=${!mayRecord.value} onClick=${() => startOrStop(link)}><i></i></button>`}
    <div class="grow" aria-live="polite">
      <h1>${isRecording ? t("record.recording", { time: clock(now?.seconds ?? 0) }) : t("record.ready")}</h1>
      <p class="mut num">${factsOf(now)}</p>
    </div>
    <button class="btn" aria-pressed=${String(frozen.value !== null)} onClick=${freeze}><${Icon} name=${frozen.value ? "play" : "pause"} />${frozen.value ? t("record.go_on") : t("record.freeze")} <kbd class="hide-t">F</kbd></button>
    <button class="btn" disabled=${!isLive.value} onClick=${() => mark(link)}><${Icon} name="plus" />${t("record.mark")} <kbd class="hide-t">K</kbd></button>
    <${Export} link=${link} />
  </header>`;
}

/** @param {import("../../state/recording.js").Status | null} now */
function factsOf(now) {
  const facts = [
    t("record.servos", { count: servoIds.value.length }),
    t("record.marks", { count: marks.value.length }),
  ];
  if (now !== null && now.name !== "") {
    facts.push(t("record.size", { megabytes: number(now.size_bytes / 1e6, 2) }));
    facts.push(now.problem || (now.dropped ? t("record.dropped", { count: now.dropped }) : t("record.nothing_lost")));
  }
  return facts.join(" · ");
}

/** @param {number} seconds */
const clock = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;

// Menu of exports.

/** @param {{ link: import("../../link/link.js").Link }} props */
const Export = ({ link }) =>
  html`<${Menu} label=${t("record.export")} items=${[
    { label: t("record.export_recording"), run: () => saveRecording(link) },
    { label: t("record.export_table"), run: saveTable },
    { label: t("record.export_actions"), run: makeActions },
  ]} />`;

// Servos by limb, each with a check mark if plotted.

function ServoList() {
  const isAll = plotted.value.length === servoIds.value.length;
  return html`<section class="card ser">
    <header><h2>${t("record.plotted")}</h2><button class="btn s" onClick=${() => plotServos(servoIds.value, !isAll)}>${isAll ? t("record.none") : t("record.all")}</button></header>
    <div class="pad0">
      ${limbs.value.map(
        ({ limb, ids }) => html`<fieldset key=${limb} data-g=${limb}>
        <legend>${limbName(limb)}</legend>
        ${ids.map((id) => html`<${Servo} key=${id} id=${id} />`)}
      </fieldset>`,
      )}
    </div>
  </section>`;
}

/** @param {{ id: number }} props */
function Servo({ id }) {
  const isPlotted = plotted.value.includes(id);
  return html`<label>
    <input type="checkbox" checked=${isPlotted} onChange=${() => plotServos([id], !isPlotted)} />
    <span class="grow">${nameOf(id)}</span>
    <${Angle} id=${id} />
  </label>`;
}

/** @param {{ id: number }} props */
const Angle = ({ id }) =>
  html`<span class="num mut">${String(servos.value.get(id)?.angle ?? "").replace("-", "\u2212")}°</span>`;
