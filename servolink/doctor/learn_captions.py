"""Encoding of stored captions, found from the bytes of all captions on a board."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from struct import calcsize
from typing import NamedTuple

from servolink.doctor.learn_queries import Survey
from servolink.escaping import quote
from servolink.profiles.profile import Measured
from servolink.protocol.caption import CAPTION_SIZE
from servolink.protocol.codec import response_class
from servolink.protocol.editing import QueryServoParameterRequest
from servolink.protocol.packet import Packet, Value, bare, counted, field_hints, group, value
from servolink.protocol.record_types import RECORD_TYPES

_SURE = 4  # characters outside ASCII needed for certainty
_EXAMPLES = 3


def listed_captions(survey: Survey) -> list[bytes]:
    """Return the bytes of all captions in the lists of the board, padding included."""
    lists = (*(each.list_request for each in RECORD_TYPES), QueryServoParameterRequest())
    found = ((response_class(query), survey.frames[query]) for query in lists if query in survey.frames)
    return [caption for declared, (_, content) in found for caption in captions_in(declared, content)]


def encoding_finding(captions: Iterable[bytes]) -> Measured:
    """Return the only encoding where all captions are plausible text; bytes behind the end of a caption are ignored."""
    written = sorted({raw for raw in captions if any(raw)})
    fitting, note = _fitting(written), ""
    if not fitting:  # bytes behind the end, which is visible only in encodings with a zero of one byte
        written = sorted({raw.partition(b"\0")[0] for raw in written} - {b""})
        fitting, note = _fitting(written), "; bytes behind the end of captions were ignored"
    if not written:
        return Measured("caption_encoding", None, "guess", "no caption is stored on the board")
    if all(raw.isascii() and _unpadded(raw, 1) for raw in written):
        text = f"{_count(written)} only ASCII, the same in most encodings{note}"
        return Measured("caption_encoding", None, "guess", text)
    if not fitting:
        text = f"{_count(written)} no text in any of {', '.join(_ENCODINGS)}"
        return Measured("caption_encoding", None, "guess", text)
    if len(fitting) > 1:
        text = f"{_count(written)} text in {' and in '.join(fitting)}: too few to tell, or choose one yourself"
        return Measured("caption_encoding", None, "guess", text)
    ((name, texts),) = fitting.items()
    examples = ", ".join(quote(text) for text in sorted(texts, key=str.isascii)[:_EXAMPLES])
    is_sure = sum(not character.isascii() for text in texts for character in text) >= _SURE
    text = f"{_count(written)} text in {name} and in no other encoding tried: {examples}{note}"
    return Measured("caption_encoding", name, "certain" if is_sure else "likely", text)


def _fitting(written: Sequence[bytes]) -> dict[str, list[str]]:
    """Return the encodings where all captions are plausible text, with the texts."""
    fitting = {name: texts for name in _ENCODINGS if (texts := _texts(written, name)) is not None}
    # Any two letters of ASCII are a Chinese character in UTF-16.
    return {name: texts for name, texts in fitting.items() if not name.startswith("utf-16")} or fitting


def _count(captions: Sequence[bytes]) -> str:
    return "1 caption is" if len(captions) == 1 else f"{len(captions)} captions are"


def _texts(captions: Iterable[bytes], encoding: str) -> list[str] | None:
    """Return all captions as texts; None if a caption is implausible in `encoding`."""
    texts = []
    for raw in captions:
        unpadded = _unpadded(raw, 2 if encoding.startswith("utf-16") else 1)
        if unpadded is None:
            return None
        try:
            text = unpadded.decode(encoding)
        except UnicodeDecodeError:
            return None
        if not all(" " <= each <= "~" or (not each.isascii() and _ENCODINGS[encoding](each)) for each in text):
            return None
        texts.append(text)
    return texts


def _unpadded(raw: bytes, width: int) -> bytes | None:
    """Return a caption up to the terminator, `width` zeros; None if anything but zeros follows."""
    end = next((at for at in range(0, len(raw), width) if not any(raw[at : at + width])), len(raw))
    return None if any(raw[end:]) else raw[:end]


# --- where captions are in a packet ----------------------------------------------------------------------------------


class _Places(NamedTuple):
    """Positions of captions in the content of a packet."""

    head: list[int]
    base: int
    """Start of the first record of the group."""
    unit: int
    """Bytes of a record; 0 without a group."""
    record: list[int]
    """Positions of captions in each record."""


def captions_in(declared: type[Packet], content: bytes) -> list[bytes]:
    """Return the 32 bytes of each caption in `content`, for any byte order."""
    head, base, unit, record = _places(declared)
    starts = list(head)
    if record:
        starts += [at + place for at in range(base, len(content) - unit + 1, unit) for place in record]
    return [content[at : at + CAPTION_SIZE] for at in starts]


@cache
def _places(declared: type[Packet]) -> _Places:
    fixed, count, records = list[Value](), "", list[Value]()
    for name, hint in field_hints(declared).items():
        if (how := counted(hint)) is not None:
            count, records = how.count, group(hint)[1]
        elif bare(hint) is not bytes:
            fixed.append(value(name, hint))
    head, end = _captions(fixed)
    record, unit = _captions(records)
    return _Places(head, end + calcsize(f"<{count}"), unit, record)


def _captions(values: list[Value]) -> tuple[list[int], int]:
    """Return the positions of captions among `values`, and the end of the values."""
    found, at = list[int](), 0
    for each in values:
        if each.is_caption:
            found.append(at)
        at += calcsize(f"<{each.code}")
    return found, at


# --- plausible characters: the bytes of an encoding can be rare characters of another ---------------------------------


def _in_gb18030(character: str) -> bool:
    """The 3,755 characters of GB 2312 in order of sound, punctuation and wide letters."""
    return _is_between(character, "gb2312", (0xA1, 0xA3), (0xB0, 0xD7))


def _in_big5(character: str) -> bool:
    """The 5,401 characters of everyday use, and punctuation."""
    return _is_between(character, "big5", (0xA1, 0xA2), (0xA4, 0xC6))


def _in_shift_jis(character: str) -> bool:
    """Kana, the 2,965 characters of everyday use, and punctuation; not the narrow kana, encoded as single bytes."""
    return _is_between(character, "shift_jis", (0x81, 0x83), (0x88, 0x97))


def _in_euc_kr(character: str) -> bool:
    """Hangul."""
    return "\uac00" <= character <= "\ud7a3"


def _is_between(character: str, encoding: str, *leads: tuple[int, int]) -> bool:
    try:
        raw = character.encode(encoding)
    except UnicodeEncodeError:
        return False
    return len(raw) == 2 and any(low <= raw[0] <= high for low, high in leads)


def _in_unicode(character: str) -> bool:
    """Any letter of the other encodings, European letters, and symbols outside the first plane, such as faces."""
    if character >= "\U0001f300":
        return unicodedata.category(character) == "So"
    if "\u00a0" <= character < "\u0530":
        return unicodedata.category(character)[0] in "LPNSZ"
    return _in_gb18030(character) or _in_big5(character) or _in_shift_jis(character) or _in_euc_kr(character)


_ENCODINGS: dict[str, Callable[[str], bool]] = {
    "utf-8": _in_unicode,
    "gb18030": _in_gb18030,
    "big5": _in_big5,
    "shift_jis": _in_shift_jis,
    "euc_kr": _in_euc_kr,
    "utf-16-le": _in_unicode,
    "utf-16-be": _in_unicode,
}
"""Encodings to try, each with the function that decides whether a character is plausible."""
