// The texts of the page in the language that was chosen.

import { signal } from "../html.js";
import { en } from "./en.js";
import { zh } from "./zh.js";

/** @typedef {keyof typeof en} Key */
/** @typedef {"en" | "zh"} Language */

/** @type {Record<Language, Record<Key, string>>} */
const TEXTS = { en, zh };

/** Language of all texts on the page. */
export const language = signal(/** @type {Language} */ ("en"));

/**
 * Return a text, with `{name}` replaced by the value of that name. Of `singular|plural`, `count` chooses one.
 * @param {Key} key
 * @param {Record<string, string | number>} [values]
 */
export function t(key, values = {}) {
  const forms = TEXTS[language.value][key].split("|");
  return forms[values.count === 1 ? 0 : forms.length - 1].replace(/\{(\w+)\}/g, (whole, name) =>
    String(values[name] ?? whole),
  );
}

/**
 * Return an angle as people read it, such as `−20°`.
 * @param {number} angle
 */
export const degrees = (angle) => `${Math.round(angle) || 0}°`.replace("-", "\u2212");

/**
 * Return seconds as people read them, such as `0.30 s`.
 * @param {number} seconds
 * @param {number} [digits]
 */
export const seconds = (seconds, digits = 2) => `${seconds.toFixed(digits)} s`;
