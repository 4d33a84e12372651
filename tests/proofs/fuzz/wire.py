"""Parser, packets and their JSON withstand any bytes from a line."""

from __future__ import annotations

import json
import re
from typing import Any

from servolink.errors import DecodeError, EncodeError
from servolink.protocol import (
    HEADER_SIZE,
    MAGIC,
    OVERHEAD,
    PACKETS,
    ByteOrder,
    Codec,
    Frame,
    FrameParser,
    Packet,
    encode_frame,
    layout,
    packet_from_json,
    packet_to_json,
)
from tests.proofs.fuzz.errors import check, check_kept
from tests.proofs.fuzz.recipes import IDS, Cursor, content_for, made

_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
_LARGEST_FRAME = 65_544
_BEFORE_MAGIC = re.compile(b"(?=%b)" % re.escape(MAGIC))
_ENCODINGS = ("utf-8", "utf-8", "utf-8", "big5", "utf-16-le", "latin-1", "shift_jis", "gb18030")
_CODECS = {(order, name): Codec(order, name) for order in _ORDERS for name in _ENCODINGS}


def check_stream(data: bytes) -> None:
    """Parse a stream whole, and cut and abandoned as its first bytes say."""
    if len(data) < 2:
        return
    order, cuts = _ORDERS[data[0] & 1], data[1]
    if data[0] & 2:
        stream = data[2:]
        _parse(stream, order, cuts)
        return
    recipe = made(Cursor(data, 2), order)
    frames = _parse(recipe.stream, order, cuts)
    if recipe.clean:
        assert frames == recipe.frames
    elif recipe.apart:
        found = iter(frames)
        assert all(frame in found for frame in recipe.frames), "an intact frame was not found"


_MOST_HEADERS = 4096  # however many there are in a stream


def _parse(stream: bytes, order: ByteOrder, cuts: int) -> list[Frame]:
    whole = FrameParser(order, keep_skipped=cuts % 16 == 0)
    frames = whole.feed(stream)
    assert len(whole._partial) <= _LARGEST_FRAME
    frames += whole.finish()
    assert not whole._partial
    assert len(whole._entries) <= _MOST_HEADERS
    assert whole.frames == len(frames)
    _check_account(stream, frames, whole, order)
    step = max(1 + cuts % 61, len(stream) // (64 if cuts < 16 else 3))
    for chunks in (
        (stream[at : at + step] for at in range(0, len(stream), step)),
        _BEFORE_MAGIC.split(stream),  # frames in a row are a chunk each
    ):
        pieces = FrameParser(order)
        again = [frame for chunk in chunks for frame in pieces.feed(chunk)]
        assert again + pieces.finish() == frames
        assert pieces.skipped == whole.skipped
    if cuts >= 240:
        _abandon(stream, order, step)
    return frames


def _check_account(stream: bytes, frames: list[Frame], parser: FrameParser, order: ByteOrder) -> None:
    """Check that each frame stands in the stream, and that each byte is in a frame or counted as skipped."""
    taken = 0
    for packet_id, content in frames:
        assert layout(PACKETS[packet_id], order).rule.admits(len(content))
        assert encode_frame(packet_id, content, order) in stream
        taken += len(content) + OVERHEAD
    skipped = sum(parser.skipped.values())
    assert taken + skipped >= len(stream)
    if parser._skipped is not None:
        assert skipped == sum(len(data) for _, data, _ in parser._skipped)


def _abandon(stream: bytes, order: ByteOrder, step: int) -> None:
    parser = FrameParser(order)
    frames: list[Frame] = []
    for at in range(0, len(stream), step):
        frames += parser.feed(stream[at : at + step])
        while parser.partial_frame is not None:  # a frame may be begun inside of the one that is given up
            frames += parser.abandon_frame()
    assert all(encode_frame(*frame, order) in stream for frame in frames)


def check_content(data: bytes) -> None:
    """Decode a content, encode the packet again, and write it as JSON."""
    if len(data) < 3:
        return
    order, encoding = _ORDERS[data[0] & 1], _ENCODINGS[data[0] >> 1 & 7]
    codec, packet_id = _CODECS[order, encoding], IDS[data[1] % len(IDS)]
    content = data[2:] if data[0] & 128 else content_for(Cursor(data, 2), packet_id, order)
    try:
        packet = codec.decode(packet_id, content)
    except DecodeError as error:
        check_kept(error, content)
        return
    _check_exact(codec, packet, content)
    _check_plain(codec, packet)
    _check_object(packet)


def _check_exact(codec: Codec, packet: Packet, content: bytes) -> None:
    """Check that a packet from a board can be written back: all but the bytes behind the end of a caption."""
    try:
        again = codec.encode(packet, unchecked=True)[HEADER_SIZE:-1]
    except EncodeError as error:
        assert codec.caption_encoding != "utf-8", "what was read cannot be written"
        check(error)
        return
    assert len(again) == len(content)
    assert codec.decode(packet.packet_id, again) == packet
    if again != content and codec.caption_encoding == "utf-8":  # others have several ways to write one character
        assert "caption" in repr(packet)
        assert all(new in (old, 0) for old, new in zip(content, again, strict=True))


def _check_plain(codec: Codec, packet: Packet) -> None:
    try:
        frame = codec.encode(packet)
    except EncodeError as error:
        check(error)
    else:
        assert codec.decode_frame(frame) == packet
        assert packet.is_in_range()


def _check_object(packet: Packet) -> None:
    described = packet_to_json(packet)
    try:
        again = packet_from_json(json.loads(json.dumps(described)))
    except EncodeError as error:
        check(error)
        assert not packet.is_in_range()
    else:
        assert again == packet


def check_frame(data: bytes) -> None:
    """Read `data` as exactly one frame."""
    for order in _ORDERS:
        codec = _CODECS[order, "utf-8"]
        try:
            packet = codec.decode_frame(data)
        except DecodeError as error:
            check_kept(error, data)
        else:
            assert FrameParser(order).feed(data) == [(packet.packet_id, data[HEADER_SIZE:-1])]


def check_json(data: bytes) -> None:
    """Read `data` as the JSON of a packet."""
    try:
        described: Any = json.loads(data)
    except (ValueError, RecursionError):
        return
    try:
        packet = packet_from_json(described)
        frame = Codec().encode(packet)
    except EncodeError as error:
        check(error)
    else:
        assert Codec().decode_frame(frame) == packet


def check_captions(data: bytes) -> None:
    """Read the first bytes as the name of an encoding, and the others as a caption in it."""
    name, _, raw = data.partition(b"\0")
    try:
        codec = Codec(caption_encoding=name.decode("utf-8", "surrogateescape"))
    except ValueError as error:
        check(error)
        return
    content = bytes(4) + raw[:32].ljust(32, b"\0") + bytes(2)
    packet = codec.decode(30021, content)
    _check_exact(codec, packet, content)
    _check_plain(codec, packet)
