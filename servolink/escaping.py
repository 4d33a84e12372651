"""Escape text from a board, a file or the operating system before people see it, also in the tables of notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

# Controls, format characters (bidi overrides), lone surrogates, private use, unassigned, and the two separators
# of lines: a terminal or a log obeys or misreads each of these characters.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
# Letters and marks without a visible shape, by which two different names can look alike.
_BLANKS = "\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0"
# Joiners, needed inside emoji and several scripts.
_JOINERS = "\u200c\u200d"

_LONGEST_QUOTE = 80
_SURROGATE = r"\udc"  # the beginning of an undecodable byte in the result of `repr`


def escape(text: str) -> str:
    """Return `text` with each control, bidi and undecodable character written as an escape.

    Escaping twice is the same as escaping once.
    """
    if text.isprintable() and text.isascii():
        return text
    return "".join(map(_escape_character, text))


def quote(value: object) -> str:
    """Return `repr(value)`, escaped and at most 80 characters long."""
    try:
        text = escape(repr(value)[: 2 * _LONGEST_QUOTE])  # a megabyte would take a second to escape
    except (ValueError, RecursionError):  # an integer of thousands of digits; lists nested too deeply
        return f"this {type(value).__name__}"
    if _SURROGATE in text:
        text = _with_bytes(text)
    return text if len(text) <= _LONGEST_QUOTE else text[: _LONGEST_QUOTE - 3] + "..."


def _with_bytes(text: str) -> str:
    """Return the result of `repr` with undecodable bytes as `escape` writes them."""
    import re  # late: few texts have such bytes

    return re.sub(r"(?<!\\)((?:\\\\)*)\\udc([89a-f][0-9a-f])", r"\1\\x\2", text)


def html_table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Return a table in HTML. Cells may be hostile: their text is escaped, and hidden characters are shown."""
    from html import escape as escape_html  # late: few programs run in notebooks

    def row(cells: Sequence[object], tag: str) -> str:
        return f"<tr>{''.join(f'<{tag}>{escape_html(escape(str(cell)))}</{tag}>' for cell in cells)}</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    title = f"<caption>{escape_html(escape(caption))}</caption>" if caption else ""
    return f"<table>{title}{row(columns, 'th')}{body}</table>"


def _escape_character(character: str) -> str:
    import unicodedata  # late: most text is ASCII

    hidden = character in _BLANKS or unicodedata.category(character) in _HIDDEN
    if not hidden or character in _JOINERS:
        return character
    code = ord(character)
    if 0xDC00 <= code <= 0xDCFF:  # an undecodable byte (see protocol/caption.py)
        return f"\\x{code - 0xDC00:02x}"
    return f"\\x{code:02x}" if code <= 0xFF else f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
