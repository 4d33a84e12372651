// Keeps the draft of each board in this browser, so that it survives a reload and a crash.

/** @typedef {import("./records.js").Project} Project */
/** A draft, and the content of the board from which it was made. @typedef {{ board: Project, draft: Project }} Kept */

const PAUSE = 400; // milliseconds after an edit
const PREFIX = "servolink.draft.";

let timer = 0;
/** @type {(() => void) | null} */
let pending = null;

/**
 * Keep the draft of a board soon; null for a draft that equals the board.
 * @param {string} name
 * @param {Kept | null} kept
 * @param {(isKept: boolean) => void} onKept
 */
export function keepSoon(name, kept, onKept) {
  clearTimeout(timer);
  pending = () => onKept(write(name, kept));
  timer = setTimeout(keepNow, PAUSE);
}

/** Keep at once what waits to be kept. */
export function keepNow() {
  clearTimeout(timer);
  pending?.();
  pending = null;
}

/**
 * Return the draft that is kept of a board, or null.
 * @param {string} name
 * @returns {Kept | null}
 */
export function read(name) {
  try {
    return JSON.parse(localStorage.getItem(PREFIX + name) ?? "null");
  } catch {
    return null; // damaged, or the browser keeps nothing
  }
}

/**
 * @param {string} name
 * @param {Kept | null} kept
 */
function write(name, kept) {
  try {
    if (kept === null) localStorage.removeItem(PREFIX + name);
    else localStorage.setItem(PREFIX + name, JSON.stringify(kept));
    return true;
  } catch {
    return false; // full, or the browser keeps nothing
  }
}

addEventListener("pagehide", keepNow);
