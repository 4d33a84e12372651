// Where the buttons of a common gamepad are, by their ids on the board, and which ones a browser's gamepad has.

/** @typedef {{ id: number, x: number, y: number, shape: "round" | "shoulder" | "menu", label?: "above" | "below" | "left" | "right" }} Place */

/** On a field of 850 by 410, which begins at y = 20. @type {readonly Place[]} */
export const PLACES = [
  { id: 1, x: 640, y: 232, shape: "round", label: "below" },
  { id: 2, x: 690, y: 182, shape: "round", label: "right" },
  { id: 3, x: 590, y: 182, shape: "round", label: "left" },
  { id: 4, x: 640, y: 132, shape: "round", label: "above" },
  { id: 5, x: 210, y: 132, shape: "round", label: "above" },
  { id: 6, x: 260, y: 182, shape: "round", label: "right" },
  { id: 7, x: 210, y: 232, shape: "round", label: "below" },
  { id: 8, x: 160, y: 182, shape: "round", label: "left" },
  { id: 9, x: 200, y: 52, shape: "shoulder", label: "below" },
  { id: 10, x: 650, y: 52, shape: "shoulder", label: "below" },
  { id: 11, x: 390, y: 140, shape: "menu", label: "below" },
  { id: 12, x: 460, y: 140, shape: "menu", label: "below" },
];

/** The ids on the board by the number of a button in the standard layout of browsers. @type {Record<number, number>} */
export const BY_GAMEPAD = { 0: 1, 1: 2, 2: 3, 3: 4, 4: 9, 5: 10, 8: 11, 9: 12, 12: 5, 15: 6, 13: 7, 14: 8 };

const KNOWN = new Set(PLACES.map(({ id }) => id));

/**
 * Return whether all these buttons are on the common gamepad.
 * @param {Iterable<number>} ids
 */
export const isGamepad = (ids) => [...ids].every((id) => KNOWN.has(id));
