"""Captions: 32 bytes of text, NUL padded, in an encoding the document leaves open."""

from __future__ import annotations

import codecs
import re
import unicodedata

from servolink.errors import EncodeError
from servolink.printable import printable
from servolink.protocol.frame import MAGIC

CAPTION_SIZE = 32
_BYTES_AS_CODE_POINTS = "servolink.bytes"


_KEPT_BYTES = re.compile("([\udc00-\udcff]+)")


def _keep_bytes(error: UnicodeError) -> tuple[str, int]:
    """Map each byte that is no text to U+DC00 + byte: `surrogateescape`, but for every encoding and byte."""
    if not isinstance(error, UnicodeDecodeError):
        raise error
    return "".join(chr(0xDC00 + byte) for byte in error.object[error.start : error.end]), error.end


codecs.register_error(_BYTES_AS_CODE_POINTS, _keep_bytes)


def _encode_kept(text: str, encoding: str) -> bytes:
    """Encode `text`, giving kept bytes back as they were."""
    texts_and_bytes = enumerate(_KEPT_BYTES.split(text))
    return b"".join(
        bytes(ord(kept) - 0xDC00 for kept in part) if at % 2 else part.encode(encoding) for at, part in texts_and_bytes
    )


def check_encoding(encoding: str) -> str:
    """Return `encoding` if Python knows it as a text encoding; ValueError otherwise."""
    try:
        "\0".encode(encoding)
    except (LookupError, UnicodeError) as error:
        raise ValueError(
            f"caption encoding {printable(encoding)!r} is unknown; use one such as utf-8, big5 or utf-16-le"
        ) from error
    return encoding


def decode_caption(raw: bytes, encoding: str) -> str:
    """Return the text before the terminating NUL; never fails and loses no byte before it."""
    width = len("\0\0".encode(encoding)) - len("\0".encode(encoding)) if encoding != "utf-8" else 1
    if width == 1:
        text = raw.partition(b"\0")[0]
    else:
        end = next((at for at in range(0, len(raw), width) if not any(raw[at : at + width])), len(raw))
        text = raw[:end]
    return text.decode(encoding, _BYTES_AS_CODE_POINTS)


def encode_caption(text: object, encoding: str, where: str, *, from_us: bool) -> bytes:
    """Return the 32 bytes for `text`; EncodeError, naming `where`, if it does not fit whole and unchanged.

    `from_us` also refuses control characters and a hidden frame start, so that no caption written by
    this library can be taken for a frame. A board may hold what it likes.
    """
    if not isinstance(text, str):
        raise EncodeError(f"{where}: {text!r} is no text")
    shown = f"{where}: '{printable(text)}'"
    if from_us and any(_is_control(character) for character in text):
        raise EncodeError(f"{shown} holds control characters; captions are plain text")
    try:
        raw = _encode_kept(text, encoding)
    except UnicodeError as error:
        raise EncodeError(f"{shown} cannot be written in {encoding}") from error
    if len(raw) > CAPTION_SIZE:
        raise EncodeError(f"{shown} takes {len(raw)} bytes in {encoding}; a caption has 0..{CAPTION_SIZE} bytes")
    if from_us and MAGIC in raw:
        raise EncodeError(f"{shown} contains the bytes that start a frame in {encoding}")
    if decode_caption(raw, encoding) != text:
        raise EncodeError(f"{shown} would not be read back as it was written in {encoding}")
    return raw.ljust(CAPTION_SIZE, b"\0")


def _is_control(character: str) -> bool:
    code = ord(character)
    if 0xDC00 <= code <= 0xDCFF:
        code -= 0xDC00
        return code < 0x20 or code == 0x7F
    return unicodedata.category(character) == "Cc"
