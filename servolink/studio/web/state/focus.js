// Focus of something that is drawn next: the name of a new record, or a new clip, as the next keys are for it.

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
 * Return whether a part takes the focus now; only the first call after `focusNext` returns true.
 * @param {Part} part
 */
export function takesFocus(part) {
  const isIt = next === part;
  if (isIt) next = null;
  return isIt;
}
