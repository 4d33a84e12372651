// Choice of a board by a page whose studio runs in the page itself.

import { signal } from "../html.js";
import { forWindow } from "./storage.js";

/** Robot at a port of another tab. @typedef {{ tab: string, name: string, url: string }} TabRobot */

const KEY = "servolink.address",
  WATCHED = "servolink.watched";

/** Whether the studio runs in this page, without a server; the build of the page says so. */
export const isInPage = globalThis.document?.documentElement?.dataset?.studio === "worker";

/** Robot that this tab watches in place of a robot of its own; null for none. @type {TabRobot | null} */
export const watched = isInPage ? JSON.parse(forWindow.get(WATCHED) ?? "null") : null;
/** Whether the watched tab has ended. */
export const isTabClosed = signal(false);
/** Robot of another tab that this tab may watch; null for none. */
export const offered = signal(/** @type {TabRobot | null} */ (null));

export function tellTabClosed() {
  isTabClosed.value = true;
}

/** @param {TabRobot} robot */
export function tellOffer(robot) {
  offered.value = robot;
}

/** Take back what a tab has offered. @param {string} tab */
export function tellTabGone(tab) {
  if (offered.value?.tab === tab) offered.value = null;
}

/** Load the page again to watch the robot of another tab. @param {TabRobot} robot */
export function watch(robot) {
  forWindow.set(WATCHED, JSON.stringify(robot));
  location.reload();
}

/** Load the page again with a robot of this tab: the board at an address, or a new virtual robot. @param {string} [url] */
export function endWatching(url = "") {
  forWindow.remove(WATCHED);
  keepAddress(url);
  location.reload();
}

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
