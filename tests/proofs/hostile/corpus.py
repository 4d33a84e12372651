"""Texts and bytes that try to be more than text; see tests/data/hostile_texts.json."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path
from typing import NamedTuple

from servolink.protocol import CAPTION_SIZE

_JOINERS = "\u200c\u200d"  # needed inside emoji and several scripts; they only join what stands beside them
_BLANKS = "\u034f\u115f\u1160\u17b4\u17b5\u3164\uffa0"  # fillers: letters and marks without a look
_NEVER = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


class Payload(NamedTuple):
    """One of them."""

    family: str
    raw: bytes

    @property
    def text(self) -> str:
        """What a program gets that reads it as UTF-8."""
        return self.raw.decode("utf-8", "surrogateescape")

    @property
    def caption(self) -> bytes:
        """As much of it as a caption holds."""
        return self.raw[:CAPTION_SIZE]


def _payload(family: str, entry: str | dict[str, str]) -> Payload:
    raw = bytes.fromhex(entry["hex"]) if isinstance(entry, dict) else entry.encode("utf-8", "surrogatepass")
    return Payload(family, raw)


_FILE = Path(__file__).parents[2] / "data/hostile_texts.json"
PAYLOADS = tuple(
    _payload(family, entry) for family, entries in json.loads(_FILE.read_text()).items() for entry in entries
)
ONE_OF_EACH = tuple({payload.family: payload for payload in reversed(PAYLOADS)}.values())
"""The first of each family, where all would take long."""


def may_be_shown(character: str) -> bool:
    """Tell whether a character does nothing but be seen, where it stands; the end of a line does more."""
    if character in _JOINERS:
        return True
    return character not in _BLANKS and unicodedata.category(character) not in _NEVER


def controls(text: str) -> set[str]:
    """Return the characters of `text` that must not reach anybody as themselves."""
    return {character for character in set(text) if character != "\n" and not may_be_shown(character)}
