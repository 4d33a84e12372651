// Unconfirmed edits, kept in the browser: safe from a reload, a crash, and a lost connection.

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
    try {
      this._written = localStorage.getItem(this._key);
      return JSON.parse(this._written ?? "null");
    } catch {
      return null; // damaged, or the browser keeps nothing
    }
  }

  /**
   * Replace the edits; null for none. Edits of other pages in this browser stay.
   * @param {T | null} edits
   */
  write(edits) {
    const text = edits === null ? null : JSON.stringify(edits);
    try {
      if (text !== null) localStorage.setItem(this._key, text);
      else if (localStorage.getItem(this._key) === this._written) localStorage.removeItem(this._key);
      this._written = text;
    } catch {
      // full, or the browser keeps nothing: the edits are in the studio a moment later
    }
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
