// Texts of the page in the chosen language, with the plurals, numbers and dates of the language.

import { computed, signal } from "../html.js";

/** @typedef {keyof (typeof import("./en.json"))["texts"]} Key */
/** @typedef {keyof typeof LANGUAGES} Language */
/**
 * File of a language.
 * @typedef {object} Texts
 * @property {Record<string, string>} texts of the page, by key
 * @property {Record<string, { title: string, meaning: string }>} findings of the doctor, by the name of the check; none in English
 * @property {Record<string, Record<string, string>>} messages of Python, by module and English template; none in English
 */

/** Names of the languages, each written in the language itself, by the tag in the attribute `lang` of the page. */
export const LANGUAGES = { en: "English", "zh-Hans": "简体中文", "zh-Hant": "繁體中文" };

/** Categories of plurals, in the order of the forms of a text. */
const PLURALS = ["zero", "one", "two", "few", "many", "other"];

/** Language of all texts on the page. */
export const language = signal(/** @type {Language} */ ("en"));
/** Texts in the language of the page. */
export const texts = signal(/** @type {Texts} */ ({ texts: {}, findings: {}, messages: {} }));

/** Tag of the language with the region of the browser: dates in Sydney differ from dates in Chicago. */
const locale = computed(() => navigator.languages.find((tag) => languageOf(tag) === language.value) ?? language.value);
const formatOf = computed(() => new Map([0, 1, 2].map((digits) => [digits, decimals(locale.value, digits)])));
const listOf = computed(() => new Intl.ListFormat(locale.value, { type: "conjunction", style: "narrow" }));
const pluralOf = computed(() => {
  const rules = new Intl.PluralRules(language.value);
  const forms = PLURALS.filter((form) => rules.resolvedOptions().pluralCategories.some((each) => each === form));
  return (/** @type {number} */ count) => forms.indexOf(rules.select(count));
});

/**
 * Return the language of the page for a tag: `zh-Hant` for `zh-TW`, `zh-HK` and `zh-Hant`; undefined for none.
 * @param {string | undefined} tag
 */
export function languageOf(tag) {
  try {
    const { language, script } = new Intl.Locale(tag ?? "").maximize();
    return LANGUAGE_TAGS.find((each) => each === language || each === `${language}-${script}`);
  } catch {
    return undefined; // not a tag
  }
}

const LANGUAGE_TAGS = /** @type {Language[]} */ (Object.keys(LANGUAGES));

/**
 * Return the texts of a language. Rejects if the studio does not answer.
 * @param {Language} tag
 * @returns {Promise<Texts>}
 */
export const load = async (tag) => (await fetch(new URL(`${tag}.json`, import.meta.url))).json();

/**
 * Return a text with the values in place of `{name}`. The value of `count` chooses among the forms of `singular|plural`.
 * @param {Key} key
 * @param {Record<string, string | number>} [values]
 */
export function t(key, values = {}) {
  const forms = (texts.value.texts[key] ?? key).split("|");
  const form = forms.length > 1 ? pluralOf.value(Number(values.count)) : 0;
  return forms[form].replace(/\{(\w+)\}/g, (whole, name) => String(values[name] ?? whole));
}

/**
 * Return the name in the language of the page, else in English; undefined without both.
 * @param {Record<string, string>} names names by tag, such as `zh-Hant`, or `zh` for all of Chinese
 */
export const inLanguage = (names) => names[language.value] ?? names[language.value.split("-")[0]] ?? names.en;

/**
 * Return a number with separators, such as `12,345.60`.
 * @param {number} value
 * @param {0 | 1 | 2} [digits] digits behind the point
 */
export const number = (value, digits = 0) =>
  /** @type {Intl.NumberFormat} */ (formatOf.value.get(digits)).format(value);

/**
 * Return date and time in the format of the region, such as `26 Nov 2026, 18:05`.
 * @param {string} time as in ISO 8601
 */
export const dateAndTime = (time) =>
  new Date(time).toLocaleString(locale.value, { dateStyle: "medium", timeStyle: "short" });

/**
 * Return names as a list, such as `hip, knee, foot`.
 * @param {string[]} names
 */
export const list = (names) => listOf.value.format(names);

/**
 * Return an angle as people read it, such as `−20°`.
 * @param {number} angle
 */
export const degrees = (angle) => `${Math.round(angle) || 0}°`.replace("-", "\u2212");

/**
 * Return seconds as people read them, such as `0.30 s`.
 * @param {number} seconds
 * @param {0 | 1 | 2} [digits]
 */
export const seconds = (seconds, digits = 2) => `${number(seconds, digits)} s`;

/**
 * @param {string} locale
 * @param {number} digits
 */
const decimals = (locale, digits) =>
  new Intl.NumberFormat(locale, { minimumFractionDigits: digits, maximumFractionDigits: digits });
