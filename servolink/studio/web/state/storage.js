// What the browser keeps. Where it keeps nothing, as with cookies blocked, everything lasts as long as the page.

/** Storage of the browser that never throws. */
class Kept {
  /** @param {"localStorage" | "sessionStorage"} name */
  constructor(name) {
    this._name = name;
    /** @type {Map<string, string>} */
    this._here = new Map();
  }

  /** @param {string} key @returns {string | null} */
  get(key) {
    try {
      return this._here.get(key) ?? globalThis[this._name].getItem(key);
    } catch {
      return null;
    }
  }

  /**
   * Keep a text; return whether it outlasts the page.
   * @param {string} key
   * @param {string} text
   * @returns {boolean}
   */
  set(key, text) {
    try {
      globalThis[this._name].setItem(key, text);
      this._here.delete(key);
      return true;
    } catch {
      this._here.set(key, text); // the storage is blocked or full
      return false;
    }
  }

  /** @param {string} key */
  remove(key) {
    this._here.delete(key);
    try {
      globalThis[this._name].removeItem(key);
    } catch {
      // nothing is kept
    }
  }
}

/** Until the window is closed. */
export const forWindow = new Kept("sessionStorage");
/** For all windows of this browser. */
export const forBrowser = new Kept("localStorage");
