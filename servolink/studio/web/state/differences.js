// Differences between two projects, record by record.

import { idOf, KINDS, NUMBERS, withEdit } from "./records.js";

/** @typedef {import("./records.js").Project} Project */
/** @typedef {import("./records.js").Kind} Kind */
/** @typedef {import("./records.js").ProjectNumber} ProjectNumber */
/** A number of the project itself has the id 0. */
/** @typedef {{ kind: Kind | ProjectNumber, id: number, change: "added" | "changed" | "removed", before: any, after: any }} Difference */

/**
 * Return the records in which two projects differ.
 * @param {Project} before
 * @param {Project} after
 * @returns {Difference[]}
 */
export function differencesOf(before, after) {
  /** @type {Difference[]} */
  const records = KINDS.flatMap((kind) => {
    if (before[kind] === after[kind]) return [];
    const old = byId(before, kind),
      now = byId(after, kind);
    return [...new Set([...old.keys(), ...now.keys()])]
      .sort((a, b) => a - b)
      .filter((id) => !isSame(old.get(id), now.get(id)))
      .map((id) => {
        const change = !old.has(id) ? "added" : !now.has(id) ? "removed" : "changed";
        return /** @type {Difference} */ ({ kind, id, change, before: old.get(id), after: now.get(id) });
      });
  });
  const numbers = NUMBERS.filter((kind) => before[kind] !== after[kind]).map(
    (kind) => /** @type {Difference} */ ({ kind, id: 0, change: "changed", before: before[kind], after: after[kind] }),
  );
  return [...records, ...numbers];
}

/**
 * Return `draft`, made from the project `base`, as a draft of the project `board`: records that were not edited are
 * those of the board, edited ones are kept.
 * @param {Project} base
 * @param {Project} draft
 * @param {Project} board
 * @returns {Project}
 */
export const rebased = (base, draft, board) =>
  differencesOf(base, draft).reduce(
    (project, { kind, id, after }) => withEdit(project, { kind, id, record: after ?? null }),
    board,
  );

/**
 * @param {Project} project
 * @param {Kind} kind
 * @returns {Map<number, object>}
 */
const byId = (project, kind) =>
  new Map(/** @type {object[]} */ ([...project[kind]]).map((record) => [idOf(kind, record), record]));

/**
 * @param {unknown} one
 * @param {unknown} other
 */
const isSame = (one, other) => one === other || JSON.stringify(one) === JSON.stringify(other);
