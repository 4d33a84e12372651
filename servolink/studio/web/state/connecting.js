// Choice of a board by a page whose studio runs in the page itself.

import { signal } from "../html.js";
import { forWindow } from "./storage.js";

const KEY = "servolink.address";

/** Whether the studio runs in this page, without a server; the build of the page says so. */
export const isInPage = globalThis.document?.documentElement?.dataset?.studio === "worker";

/** Reason for which the latest board could not be opened again; empty without a failure. */
export const refused = signal("");

/** Return the address of the board with which the studio begins; empty for a new virtual robot. */
export const keptAddress = () => forWindow.get(KEY) ?? "";

/** Keep the address of the board until the window is closed. @param {string} url */
export function keepAddress(url) {
  if (isInPage) forWindow.set(KEY, url);
}

/** @param {string} why */
export function tellRefusal(why) {
  forWindow.remove(KEY);
  refused.value = why;
}

/** Hide the reason for which the latest board could not be opened. */
export function dismissRefusal() {
  refused.value = "";
}
