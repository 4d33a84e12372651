// Unconfirmed edits, kept in the browser: safe from a reload, a crash, and a lost connection.

import { forBrowser } from "./storage.js";

/** Unconfirmed edits of a kind and a board. @template T */
export class Unsaved {
  /** @param {string} key in the storage of the browser */
  constructor(key) {
    this._key = key;
    /** @type {string | null} */
    this._written = null;
  }

  /**
   * Return the edits of an earlier page, null for none.
   * @returns {T | null}
   */
  read() {
    this._written = forBrowser.get(this._key);
    try {
      return JSON.parse(this._written ?? "null");
    } catch {
      return null; // damaged
    }
  }

  /**
   * Replace the edits; null for none. Edits of other pages in this browser stay.
   * @param {T | null} edits
   */
  write(edits) {
    const text = edits === null ? null : JSON.stringify(edits);
    // Where the browser keeps nothing, the edits are in the studio a moment later.
    if (text !== null) forBrowser.set(this._key, text);
    else if (forBrowser.get(this._key) === this._written) forBrowser.remove(this._key);
    this._written = text;
  }
}

/**
 * Call `act` when the page is closed, loaded again, or hidden.
 * @param {() => void} act
 */
export function onLeave(act) {
  addEventListener("pagehide", act);
  document.addEventListener("visibilitychange", () => document.hidden && act());
}
