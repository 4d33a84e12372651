// Lines of many servos over the last seconds, drawn with uPlot.

import uPlot from "../vendor/uplot.js";
import { html, useEffect, useRef } from "../html.js";
import { Stretch } from "../state/stretch.js";

/** @typedef {import("../state/history.js").History} History */
/** @typedef {import("../state/history.js").Quantity} Quantity */
/** @typedef {{ history: History, ids: number[], quantity: Quantity, seconds: number, chosen: number | null, limbOf: (id: number) => string, unit: string, label: string, nowLabel: string, look: string }} Props */

const FRAME = 30; // milliseconds between two drawings, at least
const PIXELS = 2; // from one point to the next, at least
const THIN = 1, WIDE = 2.4; // pixels; without a graphics card, drawing lines of 1.4 takes three times as long as of 1
const FAINT = 0.3;
const ANGLES = [-180, 180];

/** @param {Props} props */
export function Plot(props) {
  const parent = useRef(/** @type {HTMLElement | null} */ (null));
  const { ids, quantity, chosen, look } = props;
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
  }, [ids.join(), quantity, chosen, look]);
  return html`<div class="plot" ref=${parent} role="img" aria-label=${props.label}></div>`;
}

/**
 * @param {uPlot} plot
 * @param {Props} props
 */
function draw(plot, { history, ids, quantity, seconds }) {
  const stretch = new Stretch(history, seconds, plot.width / PIXELS);
  plot.setData([stretch.times(history.times), ...ids.map((id) => stretch.values(history.of(id)[quantity]))], quantity !== "angle");
  plot.setScale("x", { min: -seconds, max: 0 });
  if (quantity === "angle") plot.setScale("y", { min: ANGLES[0], max: ANGLES[1] });
}

/**
 * @param {HTMLElement} element
 * @param {Props} props
 */
function options(element, { ids, chosen, limbOf, unit, nowLabel }) {
  const style = getComputedStyle(document.documentElement);
  /** @param {string} name */
  const colour = (name) => style.getPropertyValue(name).trim();
  const axis = { stroke: colour("--ink-3"), font: "500 11px Inter, system-ui", grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false } };
  return {
    ...sizeOf(element),
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 12, 0, 0],
    scales: { x: { time: false }, y: {} },
    axes: [
      { ...axis, grid: { show: false }, values: (/** @type {unknown} */ _, /** @type {number[]} */ ticks) => ticks.map((tick) => (tick === 0 ? nowLabel : `${minus(tick)} s`)) },
      { ...axis, size: 50, values: (/** @type {unknown} */ _, /** @type {number[]} */ ticks) => ticks.map((tick) => `${minus(tick)}${unit}`) },
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

/** @param {HTMLElement} element */
const sizeOf = (element) => ({ width: element.clientWidth, height: element.clientHeight });

/** @param {number} value */
const minus = (value) => String(value).replace("-", "\u2212");
