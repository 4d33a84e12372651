"""What received bytes show about firmware, bridge or line: each change of right frames is named, damage is not.

Module: servolink.connection.line_marks.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

from servolink.connection.evidence import LineEvidence
from servolink.connection.line_marks import described_bytes, ends_inside, marks_in, unread
from servolink.protocol import MAGIC, encode_frame

CONTENTS = {
    30131: b"\x92\x10\0\x0d",
    10031: b"\1\0\x11\0\0\0\1\0",
    10041: b"\x66\xff",
    40061: b"\1\0\0\0",
    20011: b"\2\1\2",
}
FRAMES = [encode_frame(packet_id, content, "little") for packet_id, content in CONTENTS.items()]


def each(change: Callable[[bytes], bytes]) -> bytes:
    """Return all frames, changed one by one."""
    return b"".join(map(change, FRAMES))


def with_sum(body: bytes) -> bytes:
    return body + bytes((sum(body) % 256,))


def with_length(frame: bytes, length: int) -> bytes:
    return with_sum(frame[:6] + length.to_bytes(2, "little") + frame[8:-1])


def exclusive_or(frame: bytes) -> bytes:
    total = 0
    for one in frame[:-1]:
        total ^= one
    return frame[:-1] + bytes((total,))


CHANGED = {
    "content sum": (
        each(lambda one: one[:-1] + bytes((sum(one[8:-1]) % 256,))),
        "checksum",
        "the sum of the content only",
    ),
    "exclusive or": (each(exclusive_or), "checksum", "the exclusive or of all bytes"),
    "two bytes": (each(lambda one: one[:-1] + b"\x5a\xa5"), "checksum", "is not the one of the document"),
    "no sum": (each(lambda one: one[:-1]), "checksum", "each ends before its checksum"),
    "no sum, and a byte by chance": (
        (FRAMES[1][:-1] + encode_frame(10031, b"\x10\xff\0\0\0\0\1\0", "little")[:-1] + FRAMES[4][:-1]) * 2,
        "checksum",
        "each ends before its checksum",
    ),
    "whole length": (each(lambda one: with_length(one, len(one))), "length", "counts the whole frame"),
    "big length": (each(lambda one: with_length(one, (len(one) - 9) << 8)), "length", "in the other byte order"),
    "same id": (
        b"".join(encode_frame(each - 1, content, "little") for each, content in CONTENTS.items()),
        "ids",
        "the id of its request",
    ),
    "unknown ids": (
        b"".join(
            with_sum(MAGIC + (each + 7).to_bytes(2, "little") + one[6:-1])
            for each, one in zip(CONTENTS, FRAMES, strict=True)
        ),
        "ids",
        "none of the document",
    ),
    "short list": (encode_frame(30011, bytes(73), "little") * 2, "contents", "73 bytes of content, and 2 + 36"),
    "telnet": (each(lambda one: one.replace(b"\xff", b"\xff\xff")) * 2, "telnet", "doubles ff"),
    "negotiation": (bytes.fromhex("fffb01fffb03") + each(bytes), "telnet", "ff fb 01"),
    "line ends": (each(lambda one: one.replace(b"\r", b"\r\n")) * 2, "line ends", "0a behind each 0d"),
    "utf-8": (each(lambda one: one.decode("latin-1").encode()) * 2, "text bridge", "text in UTF-8"),
    "undecodable": (each(lambda one: one.decode("utf-8", "replace").encode()) * 2, "text bridge", "ef bf bd"),
    "digits": (each(bytes).hex(" ").encode(), "text bridge", "hexadecimal digits"),
    "inverted": (bytes(255 - one for one in each(bytes)), "inverted bits", "inverted bits"),
    "reversed": (bytes(int(f"{one:08b}"[::-1], 2) for one in each(bytes)), "bit order", "reverse order"),
    "even parity": (
        bytes(one & 127 | ((one & 127).bit_count() % 2) << 7 for one in each(bytes)),
        "serial settings",
        "even parity",
    ),
    "bit 7 of some bytes": (
        bytes(one & 127 | (at % 3 == 0) << 7 for at, one in enumerate(each(bytes) * 2)),
        "serial settings",
        "another use of bit 7",
    ),
    "no 0d": (each(bytes).replace(b"\r", b"") * 2, "dropped bytes", "each 0d is missing"),
    "no XON": (each(bytes).replace(b"\x11", b"") * 2, "dropped bytes", "each XON, 11 is missing"),
    "flow control": (each(lambda one: b"\x13\x11" + one), "flow control", "sends 13 11"),
}


@pytest.mark.parametrize("name", CHANGED)
def test_each_change_of_frames_is_named(name: str) -> None:
    data, subject, words = CHANGED[name]
    mark = marks_in(data, "little")[0]
    assert mark.name == subject
    assert words in mark.text
    assert words in described_bytes(data, "little")
    assert mark.remedy
    assert "\n" not in LineEvidence(data=data, byte_order="little").explain_silence("6 queries in 3.0 s")


@pytest.mark.parametrize("seed", range(30))
def test_damage_is_no_change(seed: int) -> None:
    """Inserted, lost and wrong bytes in a hundred frames are not explained."""
    chance = Random(seed)
    data = bytearray(each(bytes) * 20)
    for _ in range(20):
        at = chance.randrange(len(data))
        data[at : at + chance.choice((0, 1, 1))] = bytes((chance.randrange(256),) * chance.choice((0, 1)))
    assert marks_in(bytes(data), "little") == []


def test_an_unknown_frame_of_another_length_is_damage_although_its_sum_is_right() -> None:
    cut = [with_sum(MAGIC + b"\xff\x7f" + one[6:-2]) for one in FRAMES if len(one) > 10]
    assert marks_in(b"".join(cut), "little") == []


def test_a_byte_that_one_frame_lacks_each_time_proves_no_dropped_bytes() -> None:
    lacking = FRAMES[1].replace(b"\x11", b"")
    assert marks_in(lacking * 3, "little") == []


def test_right_frames_have_no_marks_and_nothing_unread() -> None:
    data = each(bytes) * 3
    assert marks_in(data, "little") == []
    assert unread(data + bytes(7), "little") == []


@pytest.mark.parametrize(
    ("data", "words"),
    [(b"ERR 30130\r\n", "sends text, 'ERR 30130'"), (FRAMES[0] + b"\x80\x81", "sends 80 81")],
)
def test_other_bytes_are_shown(data: bytes, words: str) -> None:
    assert described_bytes(data, "little") == words


@pytest.mark.parametrize("size", [0, 1, 2, 4, 5, 8, 12, 13])
def test_the_end_of_a_frame_is_known(size: int) -> None:
    assert ends_inside(FRAMES[1] + FRAMES[0][:size]) == (1 < size < 13)


def test_a_mark_explains_why_no_response_was_found() -> None:
    evidence = LineEvidence(data=CHANGED["inverted"][0], byte_order="little")
    words = evidence.explain_silence("6 queries in 3.0 s")
    assert words.startswith("sends each byte with inverted bits")
    assert " (6 queries in 3.0 s): something between this computer and the board changes the bytes" in words
