// The colours of the figure, from the tokens of the page.

/** @typedef {import("./matrix.js").Vector} Vector */
/** @typedef {{ shell: Vector, dark: Vector, glow: Vector, line: Vector, accent: Vector, groups: Record<string, Vector>, isNight: boolean, css: Record<"accent" | "ink" | "muted" | "panel", string> }} Palette */

const GROUPS = ["ra", "la", "rm", "lm", "rl", "ll"];

/** @type {Palette | null} */
let current = null;

/** Return the colours of the present theme. */
export function palette() {
  current ??= read();
  return current;
}

/** Read the colours again: the theme has changed. */
export function forgetPalette() {
  current = null;
}

/** @returns {Palette} */
function read() {
  const root = document.documentElement,
    style = getComputedStyle(root);
  /** @param {string} name */
  const text = (name) => style.getPropertyValue(name).trim();
  /** @param {string} name */
  const colour = (name) => parse(text(name));
  return {
    shell: colour("--fig-shell"),
    dark: colour("--fig-dark"),
    glow: colour("--fig-glow"),
    line: colour("--fig-grid"),
    accent: colour("--accent"),
    groups: Object.fromEntries(GROUPS.map((group) => [group, colour(`--limb-${group}`)])),
    isNight: root.dataset.theme === "dark",
    css: { accent: text("--accent"), ink: text("--ink"), muted: text("--ink-3"), panel: text("--panel") },
  };
}

/**
 * Return red, green and blue, 0..1 each.
 * @param {string} text as in `#4f4fd0` or `#fff`
 * @returns {Vector}
 */
function parse(text) {
  let digits = text.replace("#", "") || "888";
  if (digits.length === 3) digits = [...digits].map((digit) => digit + digit).join("");
  return /** @type {Vector} */ ([0, 2, 4].map((at) => parseInt(digits.slice(at, at + 2), 16) / 255));
}
