// How far Python has come into the page, where the studio runs in the page itself.

import { signal } from "../html.js";

/** @typedef {{ loaded: number, total: number }} Loading bytes that have come, and that are to come in all */

/** @type {{ value: Loading | null }} null before the first bytes */
export const loading = signal(/** @type {Loading | null} */ (null));
/** Why Python could not be loaded; empty if it could, or may yet be. */
export const failure = signal("");
/** Why files of the user cannot be kept in the browser; empty if they are. */
export const unkept = signal("");

/** @param {Loading} now */
export function tellLoading(now) {
  loading.value = now;
  failure.value = "";
}

/** @param {string} why */
export function tellFailure(why) {
  failure.value = why;
}

/** @param {string} why */
export function tellUnkept(why) {
  unkept.value = why;
}
