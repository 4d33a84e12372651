// Settings kept in the browser: language, theme, and name of the page.

import { batch, effect, signal } from "../html.js";
import { forgetPalette } from "../figure/palette.js";
import { forBrowser } from "./storage.js";
import { language, languageOf, load, texts } from "../texts/text.js";

const KEY = "servolink.settings";

/** @typedef {"light" | "dark"} Theme */
/** @typedef {import("../texts/text.js").Language} Language */
/** @typedef {{ theme?: Theme, language?: Language, who?: string }} Settings */

const known = read();

/** Theme of the page; the browser's preference before a choice. */
export const theme = signal(known.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
/** Name of this page for people at other pages. */
export const who = signal(known.who ?? "");
/** Language chosen in this browser; undefined before a choice. */
const chosen = signal(known.language);

effect(() => {
  document.documentElement.dataset.theme = theme.value;
  document.documentElement.lang = language.value;
  forgetPalette();
  write({ theme: theme.value, language: chosen.value, who: who.value });
});

/** @returns {Settings} */
function read() {
  try {
    return JSON.parse(forBrowser.get(KEY) ?? "{}");
  } catch {
    return {}; // damaged
  }
}

/** @param {Settings} settings */
function write(settings) {
  forBrowser.set(KEY, JSON.stringify(settings));
}

/** Change between the light and the dark theme. */
export function changeTheme() {
  theme.value = theme.value === "dark" ? "light" : "dark";
}

/** Show the page in the language chosen before, else in the first available language among the preferences of the browser. */
export const showLanguage = () => show([chosen.value, ...navigator.languages].map(languageOf).find(Boolean) ?? "en");

/**
 * Show the page in another language from now on.
 * @param {Language} name
 */
export function chooseLanguage(name) {
  chosen.value = name;
  return show(name);
}

/** @param {Language} name */
async function show(name) {
  const loaded = await load(name);
  batch(() => {
    texts.value = loaded;
    language.value = name;
  });
}

/**
 * Set the name of the page for people at other pages.
 * @param {string} name
 */
export function renamePage(name) {
  who.value = name;
}
