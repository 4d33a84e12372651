// Lanes of moving servos, or of limbs; the text in a bar is the final angle.

import { computed, html } from "../../html.js";
import { limbName, limbOf, limbs, nameOf } from "../../state/figure.js";
import { capOf } from "../../state/limits.js";
import { speedOf } from "../../state/macro-time.js";
import { course } from "../../state/shown-macro.js";
import { place, span } from "../../state/timeline.js";
import { chooseServo, chosen } from "../../state/view.js";
import { degrees } from "../../texts/text.js";

/** @typedef {import("../../state/macro-time.js").Turn} Turn */

const STILL = 0.5; // degrees
const ROOM = 0.028; // share of the timeline from which an angle fits a bar
const MOST_BARS = 400; // of a lane

/** The turns in which something moves, by servo. */
const turns = computed(() => {
  /** @type {Map<number, Turn[]>} */
  const found = new Map();
  for (const turn of course.value?.turns ?? []) {
    if (Math.abs(turn.end - (turn.start ?? turn.end + 1)) <= STILL) continue;
    found.set(turn.servoId, [...(found.get(turn.servoId) ?? []), turn]);
  }
  return found;
});

/** Moving servos, grouped by limb. */
export const movedServos = computed(() => {
  const order = limbs.value.flatMap((limb) => limb.ids),
    strangers = [...turns.value.keys()].filter((id) => !order.includes(id));
  return [...order.filter((id) => turns.value.has(id)), ...strangers];
});

/** Lanes of the single servos in the order of their ids. */
export const ServoLanes = () =>
  movedServos.value.map(
    (id) => html`<div class="lane" key=${id} data-g=${limbOf(id)}>
    <button class="lb plain" title=${nameOf(id)} aria-pressed=${String(chosen.value === id)} onClick=${() => chooseServo(id)}><span class="sid">${id}</span><span class="ell">${nameOf(id)}</span></button>
    <div class="bd">${(turns.value.get(id) ?? []).slice(0, MOST_BARS).map(bar)}</div>
  </div>`,
  );

/** Lanes of moving limbs, each with all servos of the limb together. */
export function LimbLanes() {
  const moving = limbs.value.filter(({ ids }) => ids.some((id) => turns.value.has(id)));
  return moving.map(
    ({ limb, ids }) => html`<div class="lane" key=${limb} data-g=${limb}>
    <div class="lb" title=${limbName(limb)}><span class="gd"></span><span class="ell">${limbName(limb)}</span></div>
    <div class="bd">${together(ids)
      .slice(0, MOST_BARS)
      .map(
        (each) =>
          html`<div class=${each.isFast ? "mv fast" : "mv"} style=${place(each)}>${isWide(each) ? each.count : ""}</div>`,
      )}</div>
  </div>`,
  );
}

/** @param {Turn} turn */
function bar(turn) {
  const isFast = speedOf(turn) > capOf(turn.servoId);
  return html`<div class=${isFast ? "mv fast" : "mv"} style=${place(turn)} title=${isFast ? `${Math.round(speedOf(turn))}°/s` : ""}>${isWide(turn) ? degrees(turn.end) : ""}</div>`;
}

/**
 * Return the turns of several servos that begin together as one, with their number.
 * @param {number[]} ids
 */
function together(ids) {
  /** @type {Map<number, { from: number, until: number, count: number, isFast: boolean }>} */
  const found = new Map();
  for (const turn of ids.flatMap((id) => turns.value.get(id) ?? [])) {
    const { until = 0, count = 0, isFast = false } = found.get(turn.from) ?? {};
    found.set(turn.from, {
      from: turn.from,
      until: Math.max(until, turn.until),
      count: count + 1,
      isFast: isFast || speedOf(turn) > capOf(turn.servoId),
    });
  }
  return [...found.values()].sort((a, b) => a.from - b.from);
}

/** @param {{ from: number, until: number }} what */
const isWide = ({ from, until }) => (until - from) / span.value > ROOM;
