// Record: a file of all that happens, and three plots of the servos on one time axis.

import { html, useEffect } from "../../html.js";
import { Icon } from "../../parts/icon.js";
import { useKeys } from "../../parts/keys.js";
import { Plot } from "../../parts/plot.js";
import { limbOf } from "../../state/figure.js";
import { open } from "../../state/project.js";
import { history, isLive, servoIds } from "../../state/robot.js";
import { theme } from "../../state/settings.js";
import { chosen } from "../../state/view.js";
import { t } from "../../texts/text.js";
import {
  freeze,
  frozen,
  mark,
  marks,
  mayRecord,
  plotted,
  refresh,
  startOrStop,
  status,
} from "../../state/recording.js";
import { Export } from "./export-menu.js";
import { ServoList } from "./servo-list.js";

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
          limbOf=${limbOf} unit=${unit} label=${t(title)} nowLabel=${frozen.value ? "0 s" : t("live.now")} look=${`${theme.value} ${frozen.value !== null}`} marks=${marks} />
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
    <button class="recbtn" aria-pressed=${String(isRecording)} aria-label=${label} title=${label} disabled=${!mayRecord.value} onClick=${() => startOrStop(link)}><i></i></button>
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
    facts.push(t("record.size", { megabytes: (now.size_bytes / 1e6).toFixed(2) }));
    facts.push(now.problem || (now.dropped ? t("record.dropped", { count: now.dropped }) : t("record.nothing_lost")));
  }
  return facts.join(" · ");
}

/** @param {number} seconds */
const clock = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
