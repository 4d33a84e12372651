// Test of the line: test data and a query again and again, with a picture of the times and losses.

import { html, useEffect, useRef, useState } from "../../html.js";
import { Note } from "../../parts/note.js";
import { safeText } from "../../parts/safe-text.js";
import { Segments } from "../../parts/segments.js";
import { isLive, welcome } from "../../state/robot.js";
import { number, t } from "../../texts/text.js";

/** Answer to one query behind test data. @typedef {{ seconds: number | null, repeats: number, noise: number }} Try */

const TRIES = 40;
const SIZES = [16, 256, 2048]; // bytes of test data before each query
const LEAST_SCALE = 5; // milliseconds of a bar of full height, at least

/** @param {{ link: import("../../link/link.js").Link }} props */
export function LineTestCard({ link }) {
  const [tries, setTries] = useState(/** @type {Try[]} */ ([])),
    [size, setSize] = useState(SIZES[1]);
  const [isRunning, setRunning] = useState(false),
    [error, setError] = useState("");
  const wanted = useRef(false);
  useEffect(() => () => void (wanted.current = false), []);
  const run = async () => {
    wanted.current = true;
    setRunning(true);
    setError("");
    /** @type {Try[]} */
    const found = [];
    setTries(found);
    try {
      while (wanted.current && found.length < TRIES) {
        found.push(await link.call("line.test", { size }));
        setTries([...found]);
      }
    } catch (failure) {
      setError(failure instanceof Error ? failure.message : "");
    }
    setRunning(false);
  };
  if (welcome.value?.role !== "edit") return null;
  return html`<section class="card" aria-labelledby="line-title">
    <header class="wrap"><h2 id="line-title">${t("line.title")}</h2>
      ${
        isRunning
          ? html`<button class="btn s" onClick=${() => (wanted.current = false)}>${t("line.end")}</button>`
          : html`<button class="btn s" disabled=${!isLive.value} onClick=${run}>${t("line.run")}</button>`
      }
    </header>
    <div class="pad0 stack">
      <p class="mut">${t("line.detail", { count: TRIES })}</p>
      <div><${Segments} small label=${t("line.size")} value=${String(size)} onChoose=${(/** @type {string} */ value) => setSize(Number(value))}
        choices=${SIZES.map((bytes) => ({ value: String(bytes), label: t("line.bytes", { count: bytes }) }))} /></div>
      ${tries.length > 0 && html`<${Picture} tries=${tries} />`}
      ${error && html`<${Note} kind="bad" title=${safeText(error)} />`}
      ${tries.length > 0 && !isRunning && html`<${Verdict} tries=${tries} />`}
    </div>
  </section>`;
}

/** @param {{ tries: Try[] }} props */
function Picture({ tries }) {
  const scale = Math.max(LEAST_SCALE, ...tries.map(({ seconds }) => (seconds ?? 0) * 1000));
  return html`<div class="losses" role="img" aria-label=${summary(tries)}>
    ${tries.map((one, at) => {
      const kind = one.seconds === null ? "lost" : one.repeats > 0 || one.noise > 0 ? "bad" : "";
      const height = one.seconds === null ? 100 : Math.max(8, (one.seconds * 100_000) / scale);
      return html`<i key=${at} class=${kind} style=${{ height: `${height}%` }}></i>`;
    })}
  </div>`;
}

/** @param {{ tries: Try[] }} props */
function Verdict({ tries }) {
  const lost = tries.filter(({ seconds }) => seconds === null).length;
  const repeats = tries.reduce((sum, one) => sum + one.repeats, 0),
    noise = tries.reduce((sum, one) => sum + one.noise, 0);
  const isGood = lost === 0 && repeats === 0 && noise === 0;
  const detail = isGood ? "" : t("line.losses", { lost, repeats, noise });
  return html`<${Note} kind=${isGood ? "ok" : "warn"} title=${summary(tries)} detail=${detail} />`;
}

/** @param {Try[]} tries */
function summary(tries) {
  const times = tries.flatMap(({ seconds }) => (seconds === null ? [] : [seconds * 1000])).sort((a, b) => a - b);
  const values = { answered: times.length, count: tries.length };
  if (times.length === 0) return t("line.none", values);
  const shown = (/** @type {number} */ time) => number(time, time < 10 ? 1 : 0);
  return t("line.summary", {
    ...values,
    median: shown(times[times.length >> 1]),
    longest: shown(times[times.length - 1]),
  });
}
