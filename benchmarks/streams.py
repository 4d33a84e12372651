"""Streams to parse: clean, damaged as real lines damage them, and made to hurt. All from a seed."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

from servolink.protocol.codec import PACKETS, Codec
from servolink.protocol.editing import QueryActionListResponse
from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, OVERHEAD, ByteOrder, encode_frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.layouts import layout
from servolink.protocol.packet import Packet
from servolink.protocol.records import ActionEntry
from servolink.protocol.servos import QueryServoResponse, ServoState
from servolink.protocol.settings import SendDummyDataRequest

TYPICAL: dict[int, Packet] = {
    14: ButtonEventResponse(7, 1),
    186: QueryServoResponse(tuple(ServoState(at, 90 + at, 120, 400, 1, 1, 1) for at in range(16))),
    3611: QueryActionListResponse(tuple(ActionEntry(at, f"action {at}") for at in range(100))),
}
"""By frame size: a button event, the state of 16 servos, the list of 100 actions."""


def dirty(size: int, total: int, seed: int = 1) -> bytes:
    """Return about `total` bytes of frames of `size` bytes, one in 20 with a flipped bit, a cut, noise or padding."""
    random, frame, stream = Random(seed), Codec().encode(TYPICAL[size]), bytearray()
    while len(stream) < total:
        stream += frame if random.random() < 0.95 else _damaged(frame, random)
    return bytes(stream)


def damaged_line(random: Random, count: int, byte_order: ByteOrder) -> tuple[bytes, list[bytes]]:
    """Return a noisy stream and the `count` intact frames of every packet in it, in their order."""
    stream = bytearray()
    intact: list[bytes] = []
    corpus = [any_frame(random, byte_order) for _ in range(200)]
    while len(intact) < count:
        frame = random.choice(corpus)
        if random.random() < 0.4:
            stream += _damaged(frame, random)
        else:
            stream += frame
            intact.append(frame)
    return bytes(stream), intact


def lucky_line(random: Random, count: int, byte_order: ByteOrder) -> tuple[bytes, list[bytes]]:
    """Return the same where damaged frames have lost bytes, and yet have the right sum, not by chance but always."""
    stream = bytearray(b"\x01")
    intact: list[bytes] = []
    ends: list[tuple[int, int]] = []
    while len(intact) < count:
        frame = any_frame(random, byte_order)
        content = len(frame) - OVERHEAD
        if random.random() < 0.6:
            stream += frame
            intact.append(frame)
        elif content > 1:
            lost = random.randrange(1, content)
            at = random.randrange(HEADER_SIZE + 1, len(frame) - lost)
            ends.append((len(stream), len(stream) + len(frame)))
            stream += frame[:at] + frame[at + lost :]
        if random.random() < 0.3:
            stream += bytes(random.randrange(1, 60))
    for start, end in reversed(ends):  # the last one first, for what it changes is in the sums of those before it
        if end <= len(stream):
            first = start + HEADER_SIZE
            stream[first] = (stream[end - 1] - sum(stream[start : end - 1]) + stream[first]) & 0xFF
    return bytes(stream), intact


def _damaged(frame: bytes, random: Random) -> bytes:
    kind = random.randrange(6)
    if kind == 0:
        return random.randbytes(random.randrange(1, 40))
    if kind == 1:
        return bytes(random.randrange(1, 64))
    if kind == 2:
        return MAGIC[: random.randrange(1, 5)]
    if kind == 3:
        return frame[: random.randrange(1, len(frame))]
    if kind == 4:
        return frame[random.randrange(1, len(frame)) :]
    flipped = bytearray(frame)
    for at in random.sample(range(len(frame)), random.randrange(1, 4)):
        flipped[at] ^= 1 << random.randrange(8)
    return bytes(flipped)


def any_frame(random: Random, byte_order: ByteOrder) -> bytes:
    """Return a frame of any packet, of any length it may have, mostly short, with any content."""
    packet_id = random.choice(list(PACKETS))
    rule = layout(PACKETS[packet_id], byte_order).rule
    most = rule.limit if random.random() < 0.01 else min(rule.limit, random.choice((2, 20)))
    length = rule.base + rule.unit * random.randrange(min(most, 9000 // max(1, rule.unit)) + 1)
    content = random.randbytes(length) if random.random() < 0.7 else bytes(length)
    return encode_frame(packet_id, content, byte_order)


def chunks(stream: bytes, size: int) -> list[bytes]:
    """Return `stream` cut into pieces of `size` bytes."""
    return [stream[at : at + size] for at in range(0, len(stream), size)]


def hostile(size: int) -> Iterator[tuple[str, bytes]]:
    """Yield streams of `size` bytes that make a careless parser slow, with what each is made of."""
    header = HEADER["little"]
    dummy = SendDummyDataRequest.packet_id
    longest = header.pack(MAGIC, dummy, 0xFFFF)
    many = b"".join(header.pack(MAGIC, dummy, 0xFFFF - at) for at in range(8000))
    full = 0xFFFF // len(longest) * len(longest)
    bait = encode_frame(dummy, (longest * full)[:full], "little")
    nested = _nested(40_000)
    reaching = encode_frame(dummy, header.pack(MAGIC, dummy, 0xFFFF), "little")
    for name, unit in (
        ("magic after magic", MAGIC),
        ("three quarters of a magic", MAGIC[:3]),
        ("headers that claim 64 KB", longest),
        ("headers that all claim something else", many),
        ("full frames of headers, each followed by noise", bait + b"\x01"),
        ("frames that begin in each other, each followed by noise", _stairs(6, 60)),
        ("frames in frames in frames, the outermost damaged", nested[:-1] + bytes([nested[-1] ^ 1])),
        ("frames in frames in frames, on a noisy line", b"\x01" + nested),
        ("frames that reach into 64 KB of padding", reaching + bytes(0xFFFF)),
        ("short frames that reach into short padding", reaching + bytes(60)),
    ):
        yield name, (unit * (size // len(unit) + 1))[:size]


def _stairs(steps: int, size: int) -> bytes:
    """Return `steps` frames of `size` bytes, each begun 8 bytes behind the one before, and with noise behind it."""
    stream = bytearray()
    for step in range(steps):
        stream += HEADER["little"].pack(MAGIC, SendDummyDataRequest.packet_id, size - OVERHEAD - 6 * step)
    stream += bytes(size - len(stream) - 1)
    for step in range(steps):
        stream.append(sum(stream[HEADER_SIZE * step :]) & 0xFF)
        stream += b"\x01"
    return bytes(stream)


def _nested(size: int) -> bytes:
    frame = b""
    while len(frame) + OVERHEAD <= size:
        frame = encode_frame(SendDummyDataRequest.packet_id, frame, "little")
    return frame
