// Settings kept in the browser: language, theme, and name of the page.

import { effect, signal } from "../html.js";
import { forgetPalette } from "../figure/palette.js";
import { language } from "../texts/text.js";

const KEY = "servolink.settings";

/** @typedef {"light" | "dark"} Theme */
/** @typedef {{ theme?: Theme, language?: import("../texts/text.js").Language, who?: string }} Settings */

const known = read();

/** Theme of the page; the browser's preference before a choice. */
export const theme = signal(known.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
/** Name of this page for people at other pages. */
export const who = signal(known.who ?? "");

language.value = known.language ?? (navigator.language.startsWith("zh") ? "zh" : "en");

effect(() => {
  document.documentElement.dataset.theme = theme.value;
  document.documentElement.lang = language.value === "zh" ? "zh-CN" : "en";
  forgetPalette();
  write({ theme: theme.value, language: language.value, who: who.value });
});

/** @returns {Settings} */
function read() {
  try {
    return JSON.parse(localStorage.getItem(KEY) ?? "{}");
  } catch {
    return {}; // damaged, or the browser keeps nothing
  }
}

/** @param {Settings} settings */
function write(settings) {
  try {
    localStorage.setItem(KEY, JSON.stringify(settings));
  } catch {
    // the browser keeps nothing, as in a private window: the settings last as long as the page
  }
}

/** Change between the light and the dark theme. */
export function changeTheme() {
  theme.value = theme.value === "dark" ? "light" : "dark";
}

/** Change between English and Chinese on the page. */
export function changeLanguage() {
  language.value = language.value === "zh" ? "en" : "zh";
}

/**
 * Set the name of the page for people at other pages.
 * @param {string} name
 */
export function renamePage(name) {
  who.value = name;
}
