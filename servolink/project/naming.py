"""Names of servos and records: text in place of an id, and the lookup of such a text."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from msgspec import Struct

from servolink.errors import escape

_LONGEST_ID = 10  # digits
_PREFIX = "name:"
_MOST_LISTED = 5
_COMPARED = 64  # characters; a caption has at most 32 bytes, and typed text may be of any length


class Named(Struct, frozen=True, order=True):
    """Servo or record with a caption."""

    label: str
    """Type of the object, such as `action`."""
    record_id: int
    caption: str

    def __str__(self) -> str:
        """Return a text such as `action 3 'Wave'`, safe to show."""
        text = f"{self.label} {self.record_id}"
        return f"{text} '{escape(self.caption)}'" if self.caption else text

    @staticmethod
    def captioned(things: Iterable[Named], caption: str) -> list[Named]:
        """Return all objects with exactly this caption or, without any, with a caption that differs only in case.

        Duplicates are returned once, in the order of ids. No object has the empty caption.
        """
        different = [one for one in sorted(set(things)) if one.caption and caption]
        same = [one for one in different if one.caption == caption]
        return same or [one for one in different if _folded(one.caption) == _folded(caption)]

    @staticmethod
    def closest(things: Iterable[Named], caption: str, label: str) -> str:
        """Return a text with the possible meanings of `caption`, such as `did you mean action 3 'Wave'?`.

        Without a similar caption, the text lists the first few objects in the order of ids, those with captions first.
        `label` is the type of the objects.
        """
        different = sorted(set(things), key=lambda one: (not one.caption, one))
        by_text: dict[str, list[Named]] = {}
        for one in different:
            by_text.setdefault(_folded(one.caption), []).append(one)
        close = get_close_matches(_folded(caption[:_COMPARED]), by_text, n=3)
        if close:
            return f"did you mean {Named.listed([one for text in close for one in by_text[text]], 'or')}?"
        return f"there is {Named.listed(different)}" if different else f"there are no {label}s"

    @staticmethod
    def listed(things: Sequence[Named], word: str = "and") -> str:
        """Return a list of at most 5 objects for people, with the number of omitted objects."""
        shown = [*map(str, things[:_MOST_LISTED])]
        if len(things) > _MOST_LISTED:
            shown.append(f"{len(things) - _MOST_LISTED:,} more")
        return f" {word} ".join(filter(None, (", ".join(shown[:-1]), shown[-1])))


def id_or_caption(text: str) -> int | str:
    """Return the id for a text of digits, otherwise the caption.

    `name:3` is the caption `3`, and `name:name:3` the caption `name:3`.
    """
    is_id = text.isascii() and text.isdigit() and len(text) <= _LONGEST_ID
    return int(text) if is_id else text.removeprefix(_PREFIX)


def _folded(caption: str) -> str:
    """Return a text equal for captions that differ only in case or in the encoding of accents."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", caption).casefold())
