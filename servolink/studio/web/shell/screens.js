// The screens: Live comes with the page, each other one when shown first, or soon after the page is connected.

import { useEffect, useState } from "../html.js";
import { LiveScreen } from "../screens/live/index.js";
import { linkState } from "../state/robot.js";

/** @typedef {(props: import("./app.js").Tools) => any} Screen */

/** @type {Record<string, () => Promise<Screen>>} */
const LOADERS = {
  actions: async () => (await import("../screens/actions/index.js")).ActionsScreen,
  macros: async () => (await import("../screens/macros/index.js")).MacrosScreen,
  buttons: async () => (await import("../screens/buttons/index.js")).ButtonsScreen,
  teach: async () => (await import("../screens/teach/index.js")).TeachScreen,
  blocks: async () => (await import("../screens/blocks/index.js")).BlocksScreen,
  code: async () => (await import("../screens/code/index.js")).CodeScreen,
  record: async () => (await import("../screens/record/index.js")).RecordScreen,
  project: async () => (await import("../screens/project/index.js")).ProjectScreen,
  servos: async () => (await import("../screens/servos/index.js")).ServosScreen,
  board: async () => (await import("../screens/board/index.js")).BoardScreen,
  fleet: async () => (await import("../screens/fleet/index.js")).FleetScreen,
  start: async () => (await import("../screens/board/start.js")).StartScreen,
};

/** @type {Record<string, Screen>} */
const loaded = { live: LiveScreen };

/**
 * Return a screen, or null until the screen is loaded. A screen that could not be loaded is tried again with each
 * connection to the studio.
 * @param {string} name
 * @returns {Screen | null}
 */
export function useScreen(name) {
  const [, draw] = useState(0);
  const found = loaded[name] ?? null;
  useEffect(() => {
    // `found`, not `loaded`: `loadAll` may have loaded the screen between the drawing and this effect.
    if (found === null) load(name).then(() => draw((count) => count + 1));
  }, [name, linkState.value]);
  return found;
}

/** Load all screens that were not shown so far, so that they appear at once, even after the studio has ended. */
export async function loadAll() {
  for (const name of Object.keys(LOADERS)) await load(name);
}

/** @param {string} name */
async function load(name) {
  try {
    loaded[name] ??= await LOADERS[name]();
  } catch {
    // The studio does not answer; the page says so elsewhere.
  }
}
