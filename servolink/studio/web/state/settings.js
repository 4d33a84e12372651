// Settings that this browser keeps: language, theme, and the name of this page.

import { effect, signal } from "../html.js";
import { forgetPalette } from "../figure/palette.js";
import { language } from "../texts/text.js";

const KEY = "servolink.settings";

/** @typedef {"light" | "dark"} Theme */
/** @typedef {{ theme?: Theme, language?: import("../texts/text.js").Language, who?: string }} Settings */

const known = read();

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

export function changeTheme() {
  theme.value = theme.value === "dark" ? "light" : "dark";
}

export function changeLanguage() {
  language.value = language.value === "zh" ? "en" : "zh";
}

/**
 * Set the name under which people at other pages see this one.
 * @param {string} name
 */
export function renamePage(name) {
  who.value = name;
}
