// Edits that the studio has not confirmed yet, kept in this browser: safe from a reload, a crash, and a lost connection.

/** Edits of one kind and one board. @template T */
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
   * Keep edits in place of those before; null if the studio has all. What another page of this browser keeps stays.
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
 * Call `act` whenever the page may not come back: it is closed, loaded again, or hidden.
 * @param {() => void} act
 */
export function onLeave(act) {
  addEventListener("pagehide", act);
  document.addEventListener("visibilitychange", () => document.hidden && act());
}
