// Boards of a fleet, as the studio sees them at the broker: all once, then those that have changed.

import { batch, computed, effect, signal } from "../html.js";
import { RequestError } from "../link/link.js";
import { hasBoard, hasFleet, welcome } from "./robot.js";
import { screen } from "./view.js";

/** @typedef {import("../link/link.js").Link} Link */
/** @typedef {{ name: string, state: "ready" | "lost" | "closed" | "unknown" | "offline", urgency: number, host: string, battery_percent: number | null, lease: string, hold: string, may_run: boolean, problems: string[] }} Tile */
/** @typedef {{ revision: number, is_whole: boolean, is_connected: boolean, broker: string, tiles: Tile[] }} Changes */
/** @typedef {{ stopped: string[], failed: Record<string, string>, silent: string[], offline: string[] }} Stopped */

const PROBLEM = 1; // urgency up to which a board needs help

/** Boards by name. It is replaced as a whole, up to 5 times a second. */
export const tiles = signal(/** @type {Map<string, Tile>} */ (new Map()));
/** Broker, and whether it answers. */
export const broker = signal({ address: "", isConnected: true });
/** Names of boards by group. */
export const groups = signal(/** @type {Record<string, string[]>} */ ({}));
/** Why the fleet is not shown, or groups are missing; empty while all is well. */
export const fleetProblem = signal("");
/** Boards that were chosen for a run. */
export const picked = signal(/** @type {ReadonlySet<string>} */ (new Set()));

/** Number of boards that need help. */
export const needing = computed(() => [...tiles.value.values()].filter(needsHelp).length);
/** The screen in place of one that cannot be shown: without a board, or without a fleet. */
export const shownScreen = computed(() => {
  if (hasBoard.value) return screen.value === "fleet" && !hasFleet.value ? "live" : screen.value;
  return hasFleet.value && screen.value !== "board" ? "fleet" : "start";
});

/** @param {Tile} tile */
export const needsHelp = (tile) => tile.urgency <= PROBLEM;

/**
 * Follow the fleet with each connection to a studio that has one.
 * @param {Link} link
 */
export function followFleet(link) {
  effect(() => void (hasFleet.value && listen(link, welcome.value)));
}

/**
 * @param {Link} link
 * @param {typeof welcome.value} connection
 */
async function listen(link, connection) {
  let since = 0;
  try {
    while (welcome.peek() === connection) {
      const answer = /** @type {Changes} */ (await link.call("studio.fleet", { since }));
      since = answer.revision;
      batch(() => {
        broker.value = { address: answer.broker, isConnected: answer.is_connected };
        tiles.value = merged(tiles.peek(), answer);
      });
    }
  } catch (error) {
    if (error instanceof RequestError) fleetProblem.value = error.message; // else the connection begins again
  }
}

/**
 * Return the boards after an answer of the studio.
 * @param {Map<string, Tile>} before
 * @param {Pick<Changes, "is_whole" | "tiles">} answer
 */
export const merged = (before, answer) =>
  new Map([
    ...(answer.is_whole ? [] : before),
    ...answer.tiles.map((tile) => /** @type {const} */ ([tile.name, tile])),
  ]);

/**
 * Return the boards whose name, machine or problem contains a text, those that need help first.
 * @param {Iterable<Tile>} all
 * @param {{ text: string, onlyNeeding: boolean }} filter
 */
export function shownTiles(all, { text, onlyNeeding }) {
  const wanted = text.trim().toLowerCase();
  const fits = (/** @type {Tile} */ tile) =>
    (!onlyNeeding || needsHelp(tile)) &&
    [tile.name, tile.host, ...tile.problems].some((each) => each.toLowerCase().includes(wanted));
  return [...all]
    .filter(fits)
    .sort((a, b) => a.urgency - b.urgency || a.name.localeCompare(b.name, "en", { numeric: true }));
}

/**
 * Read the groups of boards again.
 * @param {Link} link
 */
export async function readGroups(link) {
  try {
    groups.value = (await link.call("studio.fleet.groups")).groups;
    fleetProblem.value = "";
  } catch (error) {
    if (error instanceof RequestError) fleetProblem.value = error.message;
  }
}

/**
 * Choose boards for a run, or none of them if all were chosen.
 * @param {readonly string[]} names
 */
export function pick(names) {
  const next = new Set(picked.value),
    areAll = names.every((name) => next.has(name));
  for (const name of names) {
    if (areAll) next.delete(name);
    else next.add(name);
  }
  picked.value = next;
}

/** Choose no board for a run. */
export function pickNone() {
  picked.value = new Set();
}

/**
 * Stop all boards of the fleet.
 * @param {Link} link
 * @returns {Promise<Stopped>}
 */
export const stopFleet = (link) => link.call("studio.fleet.stop");
