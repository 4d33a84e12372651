// Lines of many servos over the last seconds, drawn with uPlot.

import { html, useEffect, useRef } from "../html.js";
import { LENGTH } from "../state/history.js";
import { scaleOf, Stretch } from "../state/stretch.js";
import uPlot from "../vendor/uplot.js";

/** @typedef {import("../state/history.js").History} History */
/** @typedef {import("../state/history.js").Quantity} Quantity */
/** @typedef {{ history: History, ids: number[], quantity: Quantity, seconds: number, chosen: number | null, limbOf: (id: number) => string, unit: string, label: string, nowLabel: string, look: string, marks?: { value: readonly { number: number, time: number }[] } }} Props */

const FRAME = 30; // milliseconds between two drawings, at least
const PIXELS = 2; // from one point to the next, at least
const THIN = 1,
  WIDE = 2.4; // pixels; without a graphics card, drawing lines of 1.4 takes three times as long as of 1
const FAINT = 0.3;
const LEAST_SPAN = { angle: 60, current_raw: 20, temperature_raw: 20 }; // of the scale, in the unit of the plot
const LABEL_SPACE = 26; // pixels from one label of the scale to the next, at least

/** @param {Props} props */
export function Plot(props) {
  const parent = useRef(/** @type {HTMLElement | null} */ (null));
  const { ids, quantity, chosen, nowLabel, look } = props;
  useEffect(() => {
    const element = /** @type {HTMLElement} */ (parent.current);
    const plot = new uPlot(options(element, props), [[], ...ids.map(() => [])], element);
    const sizes = new ResizeObserver(() => plot.setSize(sizeOf(element)));
    sizes.observe(element);
    const timer = setInterval(() => {
      if (!document.hidden) draw(plot, props);
    }, FRAME);
    return () => {
      clearInterval(timer);
      sizes.disconnect();
      plot.destroy();
    };
  }, [ids.join(), quantity, chosen, nowLabel, look, props.history]);
  return html`<div class="plot" ref=${parent} role="img" aria-label=${props.label}></div>`;
}

/**
 * @param {uPlot} plot
 * @param {Props} props
 */
function draw(plot, { history, ids, quantity, seconds }) {
  const stretch = new Stretch(history, seconds, plot.width / PIXELS);
  plot.setData([stretch.times(history.times), ...ids.map((id) => stretch.values(history.of(id)[quantity]))], false);
  plot.setScale("x", { min: -seconds, max: 0 }); // the other scale follows the values that are shown
}

/**
 * @param {HTMLElement} element
 * @param {Props} props
 */
function options(element, { history, ids, quantity, chosen, limbOf, unit, nowLabel, marks }) {
  const style = getComputedStyle(document.documentElement);
  /** @param {string} name */
  const colour = (name) => style.getPropertyValue(name).trim();
  const axis = {
    stroke: colour("--ink-3"),
    font: "500 11px Inter, system-ui",
    grid: { stroke: colour("--line"), width: 1 },
    ticks: { show: false },
  };
  return {
    ...sizeOf(element),
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 16, 0, 0],
    hooks: marks && { draw: [(/** @type {uPlot} */ plot) => drawMarks(plot, history, marks.value, colour("--ink-2"))] },
    scales: {
      x: { time: false },
      y: {
        range: (/** @type {unknown} */ _, /** @type {number | null} */ low, /** @type {number | null} */ high) =>
          scaleOf(low, high, LEAST_SPAN[quantity]),
      },
    },
    axes: [
      {
        ...axis,
        grid: { show: false },
        values: (/** @type {unknown} */ _, /** @type {number[]} */ ticks) =>
          ticks.map((tick) => (tick === 0 ? nowLabel : `${minus(tick)} s`)),
      },
      {
        ...axis,
        size: 50,
        space: LABEL_SPACE,
        values: (/** @type {unknown} */ _, /** @type {number[]} */ ticks) =>
          ticks.map((tick) => `${minus(tick)}${unit}`),
      },
    ],
    series: [
      {},
      ...ids.map((id) => ({
        stroke: colour(limbOf(id) ? `--limb-${limbOf(id)}` : "--accent"),
        width: id === chosen ? WIDE : THIN,
        alpha: chosen === null || id === chosen ? 1 : FAINT,
        points: { show: false },
      })),
    ],
  };
}

/**
 * Draw a line with its number for each marked moment.
 * @param {uPlot} plot
 * @param {History} history
 * @param {readonly { number: number, time: number }[]} marks
 * @param {string} colour
 */
function drawMarks(plot, history, marks, colour) {
  const { ctx, bbox } = plot,
    latest = history.count > 0 ? history.times[(history.count - 1) % LENGTH] : 0;
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = colour;
  ctx.setLineDash([4, 4]);
  for (const { number, time } of marks) {
    const x = plot.valToPos(time - latest, "x", true);
    if (x < bbox.left || time > latest) continue;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.fillText(String(number), x + 3, bbox.top + 12);
  }
  ctx.restore();
}

/** @param {HTMLElement} element */
const sizeOf = (element) => ({ width: element.clientWidth, height: element.clientHeight });

/** @param {number} value */
const minus = (value) => String(value).replace("-", "\u2212");
