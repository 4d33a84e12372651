"""What a checksum of one byte lets through, and what the other checks still stop: damaged frames, drawn one by one."""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Callable
from functools import cache
from random import Random
from typing import Any

from benchmarks.measuring import Result, table
from benchmarks.textbook import TextbookParser
from servolink.errors import DecodeError
from servolink.protocol import (
    HEADER_SIZE,
    MAGIC,
    ActionEntry,
    AddActionRequest,
    AddActionResponse,
    ButtonEventResponse,
    Codec,
    Frame,
    FrameParser,
    Packet,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryActionRequest,
    QueryActionResponse,
    QueryRemainPowerResponse,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    ServoState,
    Step,
    checksum,
)

LEVELS = ("sum", "id and length", "fits the request", "read twice")
_CODEC = Codec()
_FOLLOWED_BY = (ButtonEventResponse(7, 1), QueryRemainPowerResponse(815))
_TAIL = b"".join(map(_CODEC.encode, _FOLLOWED_BY))
_TAIL_FRAMES: set[Frame] = {(packet.packet_id, _CODEC.encode(packet)[HEADER_SIZE:-1]) for packet in _FOLLOWED_BY}

Damage = Callable[[bytes, Random], bytes]
Exchange = tuple[Request[Any], Packet]


_VARIETY = 256  # what passes depends on the bytes of a frame, so each trial takes many


def _result(random: Random) -> Exchange:
    return AddActionRequest(1), AddActionResponse(random.randrange(1, 256))


def _servo(random: Random) -> Exchange:
    servo_id = random.randrange(1, 17)
    state = ServoState(servo_id, random.randrange(181), random.randrange(800), random.randrange(400, 600), 1, 1, 1)
    return QueryServoRequest(servo_id), QueryServoResponse((state,))


def _action(random: Random) -> Exchange:
    action_id = random.randrange(1, 1000)
    steps = tuple(Step(at, random.randrange(181), random.randrange(1, 200)) for at in range(1, 17))
    return QueryActionRequest(action_id), QueryActionResponse(action_id, f"action {random.randrange(1000)}", steps)


def _list(random: Random) -> Exchange:
    entries = tuple(ActionEntry(random.randrange(1, 1000), f"action {random.randrange(1000)}") for _ in range(30))
    return QueryActionListRequest(), QueryActionListResponse(entries)


EXCHANGES: dict[int, Callable[[Random], Exchange]] = {10: _result, 21: _servo, 127: _action, 1091: _list}
"""By the size of the answer: a result, one servo, an action with 16 steps, a list of 30 actions."""


def _flips(count: int) -> Damage:
    def damage(frame: bytes, random: Random) -> bytes:
        return _flipped(frame, random, count)

    return damage


def _flipped(frame: bytes, random: Random, count: int) -> bytes:
    damaged = bytearray(frame)
    for bit in random.sample(range(8 * len(frame)), count):
        damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def _bit_errors(rate: float) -> Damage:
    def damage(frame: bytes, random: Random) -> bytes:
        return _flipped(frame, random, bisect(_how_many(8 * len(frame), rate), random.random()) + 1)

    return damage


@cache
def _how_many(bits: int, rate: float) -> list[float]:
    """Return the chances of at most 1, 2, 3... errors where there is at least one."""
    chances = [math.comb(bits, count) * rate**count * (1 - rate) ** (bits - count) for count in range(1, 40)]
    return [sum(chances[: count + 1]) / (1 - (1 - rate) ** bits) for count in range(len(chances))]


def _swapped(frame: bytes, random: Random) -> bytes:
    places = [at for at in range(len(frame) - 1) if frame[at] != frame[at + 1]]
    at = random.choice(places)
    return frame[:at] + frame[at + 1 : at + 2] + frame[at : at + 1] + frame[at + 2 :]


def _lost(frame: bytes, random: Random) -> bytes:
    at = random.randrange(len(frame))
    return frame[:at] + frame[at + 1 :]


def _overwritten(frame: bytes, random: Random) -> bytes:
    at = random.randrange(len(frame) - 3)
    return frame[:at] + random.randbytes(4) + frame[at + 4 :]


DAMAGES: dict[str, Damage] = {
    "bit errors 1e-4": _bit_errors(1e-4),
    "bit errors 1e-3": _bit_errors(1e-3),
    "1 bit": _flips(1),
    "2 bits": _flips(2),
    "2 bytes swapped": _swapped,
    "1 byte lost": _lost,
    "4 bytes overwritten": _overwritten,
}


class Trial:
    """Answers of one kind, damaged in one way, many times."""

    def __init__(self, exchange: Callable[[Random], Exchange], damage: Damage, seed: str) -> None:
        """Draw answers and damage from `seed`."""
        self._random = Random(seed)
        self._damage = damage
        exchanges = [exchange(self._random) for _ in range(_VARIETY)]
        self._frames = [(request, _CODEC.encode(answer)) for request, answer in exchanges]
        self._request, self._frame = self._frames[0]

    def run(self, count: int) -> list[int]:
        """Damage so many frames; return how many of these were believed at each of LEVELS."""
        believed = [0] * len(LEVELS)
        for at in range(count):
            self._request, self._frame = self._frames[at % _VARIETY]
            damaged = self._damaged()
            if self._is_hopeless(damaged):
                continue
            believed[0] += bool(self._came_of(TextbookParser().feed(damaged + _TAIL)))
            came = self._came_of(_parse(damaged + _TAIL))
            believed[1] += bool(came)
            if accepted := self._accepted(came):
                believed[2] += 1
                believed[3] += bool(accepted & self._accepted(self._came_of(_parse(self._damaged() + _TAIL))))
        return believed

    def _damaged(self) -> bytes:
        while True:
            damaged = self._damage(self._frame, self._random)
            if damaged != self._frame:
                return damaged

    def _is_hopeless(self, damaged: bytes) -> bool:
        """Tell whether no parser can believe it: the same header, a wrong sum and no other beginning."""
        return (
            len(damaged) == len(self._frame)
            and damaged[:HEADER_SIZE] == self._frame[:HEADER_SIZE]
            and checksum(damaged[:-1]) != damaged[-1]
            and MAGIC not in damaged[1:]
        )

    def _came_of(self, frames: list[Frame]) -> set[Frame]:
        return {frame for frame in frames if frame not in _TAIL_FRAMES and frame[1] != self._frame[HEADER_SIZE:-1]}

    def _accepted(self, frames: set[Frame]) -> set[Frame]:
        return {frame for frame in frames if self._answers(*frame)}

    def _answers(self, packet_id: int, content: bytes) -> bool:
        if packet_id != self._request.packet_id + 1:
            return False
        try:
            answer = _CODEC.decode(packet_id, content)
        except DecodeError:
            return False
        return self._request.accepts(answer)  # type: ignore[arg-type]  # the id is that of the response


def _parse(data: bytes) -> list[Frame]:
    parser = FrameParser()
    return parser.feed(data) + parser.finish()


def run(*, short: bool) -> Result:
    """Damage each answer in each way, a million times."""
    count = 1_000 if short else 1_000_000
    rows, figures, wrong = [], {}, []
    for name, damage in DAMAGES.items():
        cells = []
        for size, exchange in EXCHANGES.items():
            believed = Trial(exchange, damage, f"sums {name} {size}").run(count)
            figures[f"{name}, {size} bytes"] = believed
            cells.append(" > ".join(f"{number / count * 1e6:,.0f}" for number in believed))
            if name == "1 bit" and believed[1]:
                wrong.append(f"a single wrong bit in {size} bytes was believed {believed[1]} times")
            if name.startswith("bit errors") and believed[3]:
                wrong.append(f"{name}: {size} bytes were read wrong twice in the same way {believed[3]} times")
        rows.append((name, *cells))
    quote = table(
        f"damaged responses accepted, per million damaged, after each check: {'; '.join(LEVELS)}",
        ("damage", *(f"{size:,} bytes" for size in EXCHANGES)),
        rows,
        notes=[f"{count:,} damaged frames in each cell; for the last figure the second reading is damaged too"],
    )
    return {"tables": [quote], "wrong": wrong, "figures": {"count": count, "believed": figures}}
