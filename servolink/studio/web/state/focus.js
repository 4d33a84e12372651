// Focus of the name of a new record, or of a new clip, when it is drawn.

/** @typedef {"name" | "clip"} Part */

let next = /** @type {Part | null} */ (null);

/**
 * Let a part of the screen take the focus when it is drawn.
 * @param {Part} part
 */
export function focusNext(part) {
  next = part;
}

/**
 * Return whether a part takes the focus now: true once after `focusNext`.
 * @param {Part} part
 */
export function takesFocus(part) {
  const isIt = next === part;
  if (isIt) next = null;
  return isIt;
}
