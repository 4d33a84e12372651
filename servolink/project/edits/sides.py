"""Left and right in captions."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable

from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.protocol.editing import ServoParameter

_OTHER = {"left": "right", "right": "left", "l": "r", "r": "l", "左": "右", "右": "左"}

# A letter is a side where no letter stands beside it (`L`, `l_knee`, `knee-R`, `L2`), or where capitals tell the words
# apart (`LKnee`, `kneeL`).
_SIDE = re.compile(
    r"(?i:left|right)|[左右]|(?<![^\W\d_])[LRlr](?![^\W\d_])|(?<![^\W\d_])[LR](?=[A-Z][a-z])|(?<=[a-z])[LR](?![^\W\d_])"
)
_BY_HAND = "give the pairs, as in 1=2,3=4"


def other_side(caption: str) -> str:
    """Return `caption` with left and right exchanged; the same if it names no side."""
    return _SIDE.sub(lambda found: _written_like(found[0], _OTHER[found[0].lower()]), caption)


def partners_by_caption(parameters: Iterable[ServoParameter], servo_ids: Iterable[int]) -> dict[int, int]:
    """Return the partner of each of `servo_ids` whose caption names a side, and the partner's partner.

    ProjectError if there is none, or if more than one could be meant.
    """
    captions: dict[int, str] = {}
    called = defaultdict[str, set[int]](set)
    for one in parameters:
        captions[one.servo_id] = one.servo_caption
        called[_spoken(one.servo_caption)].add(one.servo_id)
    partners: dict[int, int] = {}
    for servo_id in servo_ids:
        caption = captions.get(servo_id, "")
        if (other := other_side(caption)) == caption:
            continue
        mine, theirs = called[_spoken(caption)], called[_spoken(other)]
        if len(mine) != 1:
            raise ProjectError(f"{len(mine)} servos are called '{printable(caption)}'; {_BY_HAND}")
        if len(theirs) != 1:
            found = f"{len(theirs) or 'no'} servo{'s are' if theirs else ' is'} called '{printable(other)}'"
            raise ProjectError(f"servo {servo_id} is called '{printable(caption)}', and {found}; {_BY_HAND}")
        (partner,) = theirs
        partners[servo_id], partners[partner] = partner, servo_id
    return partners


def _spoken(caption: str) -> str:
    return " ".join(caption.casefold().split())


def _written_like(model: str, word: str) -> str:
    """Return `word` with the capitals of `model`."""
    if model.isupper():
        return word.upper()
    return word.capitalize() if model[0].isupper() else word
