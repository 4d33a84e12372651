"""Captions: 32 bytes of text, padded with NUL, in an encoding not fixed by the document."""

from __future__ import annotations

import codecs
import re
from collections.abc import Sequence

from servolink.errors import EncodeError, quote
from servolink.protocol.frame import MAGIC

CAPTION_SIZE = 32
_BYTES_AS_CODE_POINTS = "servolink.bytes"
_RAW_BYTES = "([\udc00-\udcff]+)"  # compiled on first use, as few captions have any


def _keep_bytes(error: UnicodeError) -> tuple[str, int]:
    """Decode each byte outside the encoding to U+DC00 + byte: `surrogateescape` for every encoding and every byte."""
    assert isinstance(error, UnicodeDecodeError)  # noqa: S101 - narrows the type; only decoding uses it
    return _escaped(error.object[error.start : error.end]), error.end


def _escaped(raw: bytes) -> str:
    return "".join(chr(0xDC00 + byte) for byte in raw)


codecs.register_error(_BYTES_AS_CODE_POINTS, _keep_bytes)


def _encode_escaped(text: str, encoding: str) -> bytes:
    """Encode `text`, with kept bytes turned back into the original bytes."""
    texts_and_bytes = enumerate(re.split(_RAW_BYTES, text))
    return b"".join(
        bytes(ord(character) - 0xDC00 for character in part) if at % 2 else part.encode(encoding)
        for at, part in texts_and_bytes
    )


def check_encoding(encoding: str) -> str:
    """Return `encoding` if usable for captions, else raise ValueError.

    Python must know the encoding, write no byte order mark, and encode NUL as zeros.
    """
    try:
        usable = not "".encode(encoding) and not any("\0".encode(encoding))
        b"\xff".decode(encoding, _BYTES_AS_CODE_POINTS)
    except (LookupError, UnicodeError):
        usable = False
    if not usable:
        raise ValueError(
            f"caption encoding {quote(encoding)} cannot be used; choose one such as utf-8, big5 or utf-16-le"
        )
    return encoding


def decode_caption(raw: bytes, encoding: str) -> str:
    """Return the text before the terminating NUL. Never fails, and keeps every byte before the NUL."""
    width = len("\0\0".encode(encoding)) - len("\0".encode(encoding)) if encoding != "utf-8" else 1
    if width == 1:
        text = raw.partition(b"\0")[0]
    else:
        end = next((at for at in range(0, len(raw), width) if not any(raw[at : at + width])), len(raw))
        text = raw[:end]
    found = text.decode(encoding, _BYTES_AS_CODE_POINTS)
    return found if encoding == "utf-8" or _is_form(text, found, encoding) else _decode_forms(text, encoding)


def _is_form(raw: bytes, text: str, encoding: str) -> bool:
    """Return whether `text` is encoded as `raw`: some characters of Big5 have two codes, and are read from both."""
    try:
        return _encode_escaped(text, encoding) == raw
    except UnicodeError:
        return False


def _decode_forms(raw: bytes, encoding: str) -> str:
    """Return the text of `raw`, with the bytes kept for each character that would be encoded in another form."""
    text, begun = "", 0
    decoder = codecs.getincrementaldecoder(encoding)(_BYTES_AS_CODE_POINTS)
    for end in range(1, len(raw) + 1):
        if character := decoder.decode(raw[end - 1 : end], end == len(raw)):
            form = raw[begun:end]
            text += character if _is_form(form, character, encoding) else _escaped(form)
            begun = end
    return text if _is_form(raw, text, encoding) else _escaped(raw)


def decode_captions(raws: Sequence[bytes], encoding: str) -> list[str]:
    """Decode each caption like `decode_caption`; in UTF-8, all in a single pass."""
    if encoding == "utf-8" and raws:
        texts = b"\0".join([raw.partition(b"\0")[0] for raw in raws])
        return texts.decode(encoding, _BYTES_AS_CODE_POINTS).split("\0")
    return [decode_caption(raw, encoding) for raw in raws]


def encode_caption(text: object, encoding: str, path: str, *, from_us: bool) -> bytes:
    """Return the 32 bytes for `text`. Raise EncodeError naming `path` unless `text` fits whole and unchanged.

    `from_us` also refuses control characters and a hidden frame start: no caption composed by the library can be
    mistaken for a frame. Captions from a board may have both.
    """
    if not isinstance(text, str):
        raise EncodeError(f"must be text, not {quote(text)}", path)
    if _is_simple(text, encoding) and len(text) <= CAPTION_SIZE:
        return text.encode().ljust(CAPTION_SIZE, b"\0")
    raw, fault = _raw_caption(text, encoding, from_us=from_us)
    if fault:
        raise EncodeError(f"'{text}' {fault}", path)
    return raw.ljust(CAPTION_SIZE, b"\0")


def encode_captions(texts: Sequence[str], encoding: str, *, from_us: bool) -> list[bytes]:
    """Return the bytes of each caption, not always padded. Raise EncodeError or TypeError for an unsuitable caption."""
    if _is_simple("".join(texts), encoding) and max(map(len, texts), default=0) <= CAPTION_SIZE:
        return [*map(str.encode, texts)]
    return [encode_caption(text, encoding, "", from_us=from_us) for text in texts]


def _is_simple(text: str, encoding: str) -> bool:
    """Return whether `text` is plain ASCII, like most captions: only the length needs a check."""
    return encoding == "utf-8" and text.isascii() and text.isprintable()


def _raw_caption(text: str, encoding: str, *, from_us: bool) -> tuple[bytes, str]:
    """Return the bytes of `text`, and the reason why the caption cannot be written; empty without a fault."""
    if from_us and any(_is_control(character) for character in text):
        return b"", "holds control characters; captions are plain text"
    try:
        raw = _encode_escaped(text, encoding)
    except UnicodeError:
        return b"", f"cannot be written in {encoding}"
    if len(raw) > CAPTION_SIZE:
        return raw, f"takes {len(raw)} bytes in {encoding}; a caption has 0..{CAPTION_SIZE} bytes"
    if from_us and MAGIC in raw:
        return raw, f"contains the start of a frame in {encoding}"
    if decode_caption(raw, encoding) != text:
        return raw, f"would change when written and read back in {encoding}"
    return raw, ""


def _is_control(character: str) -> bool:
    code = ord(character)
    if 0xDC00 <= code <= 0xDCFF:
        code -= 0xDC00
        return code < 0x20 or code == 0x7F
    return code < 0x20 or 0x7F <= code < 0xA0
