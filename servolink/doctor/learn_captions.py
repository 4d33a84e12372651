"""Encoding of stored captions, found from the bytes of all captions on a board."""

from __future__ import annotations

import codecs
import unicodedata
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from servolink.boards import Measured
from servolink.doctor.learn_queries import Survey
from servolink.errors import quote
from servolink.protocol import CAPTION_SIZE, PACKETS, RECORD_TYPES, QueryServoParameterRequest, layout

_SURE = 4  # characters outside ASCII needed for certainty
_EXAMPLES = 3


def listed_captions(survey: Survey) -> list[bytes]:
    """Return the bytes of all captions in the lists of the board, padding included."""
    lists = (*(each.list_request for each in RECORD_TYPES), QueryServoParameterRequest())
    found = ((PACKETS.response_of(query), survey.frames[query]) for query in lists if query in survey.frames)
    return [caption for declared, (_, content) in found for caption in layout(declared, "little").captions_in(content)]


def encoding_finding(captions: Iterable[bytes]) -> Measured:
    """Return the encoding where all captions are the most plausible text; bytes behind the end are ignored."""
    written = sorted({unpadded for raw in captions if (unpadded := raw.rstrip(b"\xff")) and any(unpadded)})
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
    (name, best), *others = sorted(fitting.items(), key=lambda each: each[1].bits)
    lead = min((other.bits - best.bits for _, other in others), default=_MOST_LEAD)
    if lead < _LEAST_LEAD:
        near = " and in ".join(other for other, reading in fitting.items() if reading.bits < best.bits + _LEAST_LEAD)
        text = f"{_count(written)} text in {near}: too few to tell, or choose one yourself"
        return Measured("caption_encoding", None, "guess", text)
    examples = ", ".join(quote(text) for text in sorted(best.texts, key=str.isascii)[:_EXAMPLES])
    characters = sum(not character.isascii() for text in best.texts for character in text)
    is_sure = characters >= _SURE and lead >= _SURE_LEAD
    rest = (
        "and in no other encoding tried" if not others else f"and hardly in {', '.join(other for other, _ in others)}"
    )
    text = f"{_count(written)} text in {name} {rest}: {examples}{note}"
    return Measured("caption_encoding", name, "certain" if is_sure else "likely", text)


class _Reading(NamedTuple):
    """All captions in one encoding."""

    texts: list[str]
    bits: float
    """How surprising the texts are."""


def _fitting(written: Sequence[bytes]) -> dict[str, _Reading]:
    """Return the encodings in which all captions are text."""
    return {name: reading for name in _ENCODINGS if (reading := _reading(written, name)) is not None}


def _count(captions: Sequence[bytes]) -> str:
    return "1 caption is" if len(captions) == 1 else f"{len(captions)} captions are"


def _reading(captions: Iterable[bytes], encoding: str) -> _Reading | None:
    """Return all captions as texts; None if `encoding` cannot decode one."""
    texts, total, rare = list[str](), _ENCODINGS[encoding], list[float]()
    decoder = codecs.getincrementaldecoder(_PYTHON.get(encoding, encoding))()
    for raw in captions:
        unpadded = _unpadded(raw, 2 if encoding.startswith("utf-16") else 1)
        if unpadded is None:
            return None
        decoder.reset()
        try:
            text = decoder.decode(unpadded).rstrip()
        except UnicodeDecodeError:
            return None
        if decoder.getstate()[0]:  # a last character that is cut, as where captions fill all bytes
            total += _CUT if len(raw) < CAPTION_SIZE else 0.0
        bits = [_bits(each, encoding) for each in text]
        if None in bits:
            return None
        texts.append(text)
        total += sum(each for each in bits if each is not None)
        rare += [each for each, character in zip(bits, text, strict=True) if each is not None and character > "~"]
    is_text = any(texts) and (not rare or sum(rare) <= _MOST_BITS * len(rare))
    return _Reading(texts, total) if is_text else None


def _unpadded(raw: bytes, width: int) -> bytes | None:
    """Return a caption up to the terminator, `width` zeros; None if anything but zeros follows."""
    end = next((at for at in range(0, len(raw), width) if not any(raw[at : at + width])), len(raw))
    if any(raw[end:]):
        return None
    return raw[:end] if width > 1 else raw[:end].rstrip(b" ")  # spaces may follow a cut character


# --- plausible characters: the bytes of an encoding can be rare characters of another ---------------------------------

_ENCODINGS = {
    "utf-8": 0.0,
    "gb18030": 0.0,
    "big5": 0.0,
    "shift_jis": 2.0,
    "euc_jp": 4.0,
    "euc_kr": 2.0,
    "utf-16-le": 4.0,
    "utf-16-be": 4.0,
}
"""Encodings to try, each with the bits by which it is rarer than the most usual ones."""
_PYTHON = {"shift_jis": "cp932", "euc_kr": "cp949", "big5": "cp950"}
"""Codecs that know more characters of the same encoding."""

_CHINESE = frozenset(
    "的一是不了在人有我他这這个個们們中来來上大为為和国國地到以说說时時要就出会會可也你对對生能下自后後作里用道行家成方多"
    "去学學如同现現动動面起看定天分好小心前开開左右手走跑停止头頭腿脚腳臂举舉挥揮转轉身体體站坐立蹲跳舞踢打拳躬拜握关關"
    "始复復位初原点點见見进進退向摇搖点抬伸张張合快慢高低二三四五六七八九十"
)
_KOREAN = frozenset(
    "이다는에의가을하고로들지기를리한사은어아인대자해서도시정나그일수보전있스라부구여제과원상장주것면안손발"
)
_JAPANESE = frozenset("手足左右上下前後歩走止動作頭腕立座振向回開閉始終大小中人一二三")

_ASCII, _FREQUENT, _KANA, _LETTER, _USUAL, _UNUSUAL, _RARE = 6.0, 8.5, 8.0, 8.0, 12.0, 16.0, 20.0
"""Bits of surprise of a character."""
_MOST_BITS = 15.5  # of a character outside ASCII, on average
_CUT = 10.0  # bits of a character cut before the end of the field
_LEAST_LEAD, _SURE_LEAD, _MOST_LEAD = 6.0, 14.0, 100.0  # bits before the next encoding


def _bits(character: str, encoding: str) -> float | None:
    """Return how surprising a character is in texts of an encoding; None for what is in no text."""
    if character.isascii():
        return _ASCII if character.isprintable() else None
    category = unicodedata.category(character)
    if category in {"Cc", "Cf", "Cn", "Co", "Cs"}:
        return None
    if encoding.startswith("utf"):
        if character < "\u2e80":
            return _LETTER if category.startswith("L") else _UNUSUAL
        return _USUAL if category == "So" else min(_east_asian_bits(character, each) for each in _LEVELS)
    return _east_asian_bits(character, encoding)


_LEVELS: dict[str, tuple[int, int, int]] = {
    "gb18030": (0xB0A1, 0xD7F9, 0xF7FE),
    "big5": (0xA440, 0xC67E, 0xF9D5),
    "shift_jis": (0x889F, 0x9872, 0xEAA4),
    "euc_jp": (0xB0A1, 0xCFD3, 0xF4A6),
    "euc_kr": (0xB0A1, 0xC8FE, 0xFDFE),
}
"""First character of everyday use, the last one, and the last one of the standard, by their two bytes."""


def _east_asian_bits(character: str, encoding: str) -> float:
    """Return the same for the encodings of Chinese, Japanese and Korean."""
    frequent = _KOREAN if encoding == "euc_kr" else _JAPANESE if encoding in {"shift_jis", "euc_jp"} else _CHINESE
    if character in frequent:
        return _FREQUENT
    if encoding in {"shift_jis", "euc_jp"} and "\u3041" <= character <= "\u30fe":
        return _KANA
    try:
        raw = character.encode(encoding)
    except UnicodeEncodeError:
        return _RARE
    code, (first, usual, last) = int.from_bytes(raw, "big"), _LEVELS[encoding]
    if len(raw) != 2 or (encoding == "gb18030" and raw[1] < 0xA1):
        return _RARE
    if code < first:
        return _UNUSUAL if unicodedata.category(character)[0] in "PZ" else _RARE
    return _USUAL if code <= usual else _UNUSUAL if code <= last else _RARE
