// Text from a board, a file or another person, with everything made visible that could deceive a reader.

// Controls, direction marks, private and unassigned characters, halves of characters, line separators, and letters that
// are drawn as nothing. The same as in `servolink/errors.py`.
const HIDDEN = /[\p{Cc}\p{Cf}\p{Cs}\p{Co}\p{Cn}\p{Zl}\p{Zp}\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0]/gu;
const JOINERS = "\u200c\u200d"; // needed inside emoji and several scripts; they only join their neighbours

/**
 * Return `text` with hidden characters written as in `\u202e`.
 * @param {string} text
 */
export const safeText = (text) =>
  text.replace(HIDDEN, (hidden) => (JOINERS.includes(hidden) ? hidden : escape(hidden)));

/** @param {string} character */
function escape(character) {
  const code = character.codePointAt(0) ?? 0;
  /** @param {number} digits */
  const hex = (digits, value = code) => value.toString(16).padStart(digits, "0");
  if (code >= 0xdc80 && code <= 0xdcff) return `\\x${hex(2, code - 0xdc00)}`; // a byte that is not text
  return code <= 0xff ? `\\x${hex(2)}` : code <= 0xffff ? `\\u${hex(4)}` : `\\U${hex(8)}`;
}
