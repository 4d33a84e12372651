"""Make text from a board, a file or the operating system safe to show."""

from __future__ import annotations

import unicodedata

# Controls, format characters (bidi overrides), lone surrogates, private use, unassigned, and the two separators
# that end a line: none of them may reach a terminal or a log as itself.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
_BLANKS = "\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0"  # letters and marks that leave no trace: a name without a look
_JOINERS = "\u200c\u200d"  # needed inside emoji and several scripts; they only join what stands beside them


def escape(text: str) -> str:
    """Return `text` with every control, bidi and undecodable character written as an escape."""
    if text.isprintable() and text.isascii():
        return text
    return "".join(_shown(character) for character in text)


def quote(value: object) -> str:
    """Return `value` as Python writes it, safe to show and at most 80 characters long."""
    try:
        text = escape(repr(value))
    except (ValueError, RecursionError):  # an integer of thousands of digits, lists nested as deep
        return f"this {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."


def _shown(character: str) -> str:
    hidden = character in _BLANKS or unicodedata.category(character) in _HIDDEN
    if not hidden or character in _JOINERS:
        return character
    code = ord(character)
    if 0xDC00 <= code <= 0xDCFF:  # a byte that was no text (see protocol/caption.py)
        return f"\\x{code - 0xDC00:02x}"
    return f"\\x{code:02x}" if code <= 0xFF else f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
