"""Captions: 32 bytes of text in any encoding, without losing or cutting anything."""

from __future__ import annotations

from encodings.aliases import aliases
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import EncodeError
from servolink.protocol.caption import CAPTION_SIZE, check_encoding, decode_caption, decode_captions, encode_caption
from servolink.protocol.frame import MAGIC
from tests.tables import over

ENCODINGS = ["utf-8", "big5", "gb18030", "shift_jis", "latin-1", "cp1252", "utf-16-le", "utf-16-be", "utf-32-le"]


def encoded(text: object, encoding: str = "utf-8", *, from_us: bool = True) -> bytes:
    return encode_caption(text, encoding, "Packet.caption", from_us=from_us)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("text", ["", "wave", "a" * 8])
def test_a_caption_is_padded_and_comes_back(encoding: str, text: str) -> None:
    raw = encoded(text, encoding)
    assert len(raw) == CAPTION_SIZE
    assert raw == text.encode(encoding).ljust(CAPTION_SIZE, b"\0")
    assert decode_caption(raw, encoding) == text


def test_chinese_in_big5_takes_two_bytes_a_character() -> None:
    assert encoded("機器人揮手", "big5")[:10] == "機器人揮手".encode("big5")
    with pytest.raises(EncodeError, match=r"takes 34 bytes in big5; a caption has 0\.\.32 bytes"):
        encoded("機" * 17, "big5")


def test_what_does_not_fit_is_refused_whole_never_cut() -> None:
    assert encoded("é" * 16)[-2:] == "é".encode()
    with pytest.raises(EncodeError, match=r"Packet\.caption: 'é+a' takes 33 bytes in utf-8; a caption has 0\.\.32"):
        encoded("é" * 16 + "a")


@pytest.mark.parametrize(
    ("text", "encoding", "fault"),
    [
        (7, "utf-8", "Packet.caption: must be text, not 7"),
        (b"wave", "utf-8", "must be text, not b'wave'"),
        ("機", "latin-1", "cannot be written in latin-1"),
        ("\ud800", "utf-8", "cannot be written in utf-8"),
        ("a\x1b[2J", "utf-8", r"'a\\x1b\[2J' holds control characters"),
        ("\udc1b", "utf-8", "holds control characters"),
        (chr(0xDC7F), "utf-8", "holds control characters"),
        ("\x80", "utf-8", "holds control characters"),
        ("\u4c13\u1d05", "utf-16-le", "contains the start of a frame"),
    ],
)
def test_captions_of_ours_are_plain_text(text: object, encoding: str, fault: str) -> None:
    with pytest.raises(EncodeError, match=fault):
        encoded(text, encoding)


def test_a_board_may_hold_control_characters_and_frame_starts() -> None:
    text = MAGIC.decode("latin-1")
    assert encoded(text, "latin-1", from_us=False).startswith(MAGIC)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le"])
def test_a_nul_would_hide_what_follows(encoding: str) -> None:
    with pytest.raises(EncodeError, match="would change when written and read back"):
        encoded("wave\0hidden", encoding, from_us=False)


@given(st.binary(min_size=32, max_size=32), st.sampled_from(["utf-8", "latin-1", "cp1252", "big5", "euc-kr", "gb2312"]))
def test_no_byte_before_the_terminator_is_lost(raw: bytes, encoding: str) -> None:
    kept = raw.partition(b"\0")[0]
    assert encoded(decode_caption(raw, encoding), encoding, from_us=False) == kept.ljust(CAPTION_SIZE, b"\0")


@given(
    st.lists(
        st.binary(min_size=32, max_size=32) | st.text(max_size=8).map(lambda text: text.encode().ljust(32, b"\0")),
        max_size=8,
    ),
    st.sampled_from(ENCODINGS),
)
def test_many_are_read_as_each_alone(raws: list[bytes], encoding: str) -> None:
    assert decode_captions(raws, encoding) == [decode_caption(raw, encoding) for raw in raws]


def test_the_terminator_is_a_whole_character() -> None:
    raw = "Ā機a".encode("utf-16-le").ljust(32, b"\0")
    assert raw[:2] == b"\x00\x01"
    assert decode_caption(raw, "utf-16-le") == "Ā機a"
    assert decode_caption("機".encode("utf-16-le") * 16, "utf-16-le") == "機" * 16


@pytest.mark.parametrize(
    ("raw", "encoding", "text"),
    [
        (b"A\xa2\xccB", "big5", "A\udca2\udcccB"),  # the other code of \u5140, \xa4\xb8
        (b"\xfbe", "cp932", "\udcfb\udc65"),  # IBM's code of what NEC has as well
        (b"2\x1b\xa4a", "iso2022_jp", "2\udc1b\udca4a"),
        (b"\x0e", "iso2022_kr", "\udc0e"),  # shifts, and says nothing
    ],
)
def test_another_code_of_a_character_is_kept_as_bytes(raw: bytes, encoding: str, text: str) -> None:
    assert decode_caption(raw.ljust(32, b"\0"), encoding) == text
    assert encode_caption(text, encoding, "x", from_us=False).rstrip(b"\0") == raw


def test_half_a_character_is_kept_as_bytes() -> None:
    raw = b"wave\xe6\xa9"
    text = decode_caption(raw.ljust(32, b"\0"), "utf-8")
    assert text == "wave\udce6\udca9"
    assert encoded(text)[:6] == raw
    assert decode_caption(b"a\0b", "utf-16-le") == "a\udc62"


@pytest.mark.parametrize(
    "encoding", ["no-such", "rot13", "hex", "undefined", "idna", "punycode", "unicode_escape", "a\x1bb"]
)
def test_an_encoding_that_cannot_hold_captions_is_refused(encoding: str) -> None:
    with pytest.raises(ValueError, match="cannot be used; choose one such as utf-8, big5 or utf-16-le") as refused:
        check_encoding(encoding)
    assert "\x1b" not in str(refused.value)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "utf-8-sig"])
def test_an_encoding_that_writes_a_byte_order_mark_is_refused(encoding: str) -> None:
    with pytest.raises(ValueError, match="cannot be used"):
        check_encoding(encoding)


def taken(encoding: str) -> bool:
    try:
        return check_encoding(encoding) == encoding
    except ValueError:
        return False


@over("encoding", [name for name in sorted({*aliases.values(), *ENCODINGS}) if taken(name)])
def test_decoding_never_fails_in_any_encoding_that_is_taken(encoding: str) -> None:
    random = Random(encoding)
    for raw in (random.randbytes(32) for _ in range(200)):
        assert isinstance(decode_caption(raw, encoding), str)
    assert decode_caption(bytes(32), encoding) == ""
    assert encoded("", encoding) == bytes(32)
