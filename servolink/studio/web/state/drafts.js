// Edits kept in the studio, record by record: safe from a reload and a crash, and visible to other pages. Edits that
// the studio has not confirmed yet are kept in this browser.

import { LinkLost } from "../link/link.js";
import { onLeave, Unsaved } from "./unsaved.js";

/** @typedef {import("./differences.js").Difference} Difference */
/** @typedef {import("../link/link.js").Link} Link */
/** Whether the studio keeps all edits, is about to, or only this browser does. @typedef {"saved" | "saving" | "here"} Keeping */
/** @typedef {{ kind: Difference["kind"], id: number, known: number, base: any, record: any, is_discarded: boolean }} Edit */
/** Edit in the browser, with the edit sent before and not answered, as JSON. @typedef {Edit & { sent?: string }} Pending */
/** @typedef {{ kind: Difference["kind"], id: number, revision: number, who: string, base: any, record: any, is_discarded: boolean }} Kept */

const PAUSE = 400; // milliseconds after an edit
const RETRY = 3000; // milliseconds after a failure
const PREFIX = "servolink.unsaved.";

/** Keeps the edits of one board. */
export class Drafts {
  /**
   * @param {Link} link
   * @param {string} board name
   * @param {object} tools
   * @param {() => Difference[]} tools.differences all edits of this page
   * @param {(kept: Kept, isConflict: boolean) => void} tools.onTheirs called with an edit of another page, which may be of
   *   a record edited by the page before
   * @param {(keeping: Keeping) => void} tools.onKept
   */
  constructor(link, board, { differences, onTheirs, onKept }) {
    this._link = link;
    /** @type {Unsaved<Pending[]>} */
    this._browser = new Unsaved(PREFIX + board);
    this._differences = differences;
    this._onTheirs = onTheirs;
    this._onKept = onKept;
    /** Records that the studio keeps, as far as this page knows. @type {Map<string, Kept>} */
    this._kept = new Map();
    /** @type {Map<string, number>} */
    this._revisions = new Map();
    /** Edits sent to the studio and not answered, as JSON. @type {Map<string, string>} */
    this._sent = new Map();
    /** Records last edited by the page. @type {Set<string>} */
    this._own = new Set();
    this._timer = 0;
    this._isSaving = false;
    link.on("studio.draft", ({ records }) => this._heard(records));
  }

  /**
   * Return the first edits of a draft: edits kept by the studio, then unsaved edits of the browser.
   * @returns {Promise<(Kept | Edit)[]>}
   */
  async load() {
    const records = await this._ask();
    for (const one of records) this._note(one);
    const unsaved = this._browser.read() ?? [];
    for (const { sent, ...edit } of unsaved) {
      if (sent !== undefined) this._sent.set(keyOf(edit), sent);
      const kept = this._kept.get(keyOf(edit));
      if (kept === undefined || !this._isOwn(kept)) this._revisions.set(keyOf(edit), edit.known); // so that newer edits are not overwritten
    }
    onLeave(() => this._keep());
    const undone = new Set(unsaved.filter((edit) => edit.is_discarded).map(keyOf)); // in the browser alone
    return [
      ...records.filter((one) => !one.is_discarded && !undone.has(keyOf(one))),
      ...unsaved.filter((edit) => !edit.is_discarded),
    ];
  }

  /** Listen again to the edits of other pages: the connection is new. */
  async resume() {
    this._heard(await this._ask());
    this.saveSoon();
  }

  /** Save all edits in a moment. */
  saveSoon(pause = PAUSE) {
    clearTimeout(this._timer);
    this._timer = setTimeout(() => this._save(), pause);
  }

  /** @returns {Promise<Kept[]>} */
  async _ask() {
    const answer = await this._link.call("studio.draft.get").catch(() => ({ records: [] }));
    return answer.records;
  }

  async _save() {
    const edits = this._keep();
    if (edits.length === 0) return this._onKept("saved");
    if (this._isSaving) return this.saveSoon();
    this._isSaving = true;
    const before = new Map(this._sent);
    for (const one of edits) this._sent.set(keyOf(one), resultOf(one));
    try {
      const { saved, conflicts } = await this._link.call("studio.draft.save", { edits });
      for (const one of saved) this._note(one);
      for (const one of saved) this._own.add(keyOf(one));
      for (const one of conflicts) {
        if (before.get(keyOf(one)) === resultOf(one))
          this._note(one); // sent before, and kept
        else this._take(one, true);
      }
      this._sent.clear();
      this.saveSoon(); // what was edited meanwhile
    } catch (error) {
      this._onKept("here");
      if (error instanceof LinkLost) this.saveSoon(RETRY); // anything else is tried again with the next edit
    } finally {
      this._isSaving = false;
    }
  }

  /**
   * Return the edits with a newer state than in the studio.
   * @returns {Edit[]}
   */
  _unsaved() {
    const edited = new Map(this._differences().map((one) => [keyOf(one), one]));
    const changed = [...edited.values()].filter((one) => !isSame(this._kept.get(keyOf(one)), one.after ?? null));
    const given = [...this._kept.values()].filter((one) => !one.is_discarded && !edited.has(keyOf(one)));
    /** @param {{ kind: Difference["kind"], id: number }} one */
    const known = (one) => this._revisions.get(keyOf(one)) ?? 0;
    return [
      ...changed.map((one) => ({
        kind: one.kind,
        id: one.id,
        known: known(one),
        base: one.before ?? null,
        record: one.after ?? null,
        is_discarded: false,
      })),
      ...given.map((one) => ({
        kind: one.kind,
        id: one.id,
        known: known(one),
        base: null,
        record: null,
        is_discarded: true,
      })),
    ];
  }

  /** @param {Kept[]} records */
  _heard(records) {
    const mine = new Set(this._unsaved().map(keyOf)); // conflicts of these appear when they are saved
    const isNew = (/** @type {Kept} */ one) => one.revision > (this._revisions.get(keyOf(one)) ?? 0);
    const theirs = records.filter((one) => isNew(one) && !mine.has(keyOf(one)));
    for (const one of theirs) this._take(one, !one.is_discarded && this._own.has(keyOf(one)));
  }

  /**
   * @param {Kept} one
   * @param {boolean} isConflict
   */
  _take(one, isConflict) {
    this._note(one);
    this._own.delete(keyOf(one));
    this._onTheirs(one, isConflict);
  }

  /** @param {Kept} one */
  _note(one) {
    this._kept.set(keyOf(one), one);
    this._revisions.set(keyOf(one), one.revision);
  }

  /**
   * Return whether a kept edit was sent by this page without an answer.
   * @param {Kept} one
   */
  _isOwn(one) {
    return this._sent.get(keyOf(one)) === resultOf(one);
  }

  /** Keep the unsaved edits in this browser, and return the edits. */
  _keep() {
    const edits = this._unsaved();
    const pending = edits.map((edit) => ({ ...edit, sent: this._sent.get(keyOf(edit)) }));
    this._browser.write(pending.length === 0 ? null : pending);
    return edits;
  }
}

/** @param {{ kind: string, id: number }} one */
const keyOf = ({ kind, id }) => `${kind} ${id}`;

/**
 * @param {Kept | undefined} kept
 * @param {unknown} record
 */
const isSame = (kept, record) =>
  kept !== undefined && !kept.is_discarded && JSON.stringify(kept.record) === JSON.stringify(record);

/** @param {Edit | Kept} one */
const resultOf = ({ record, is_discarded }) => JSON.stringify([record, is_discarded]);
