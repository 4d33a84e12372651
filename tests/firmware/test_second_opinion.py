"""Firmware and virtual board in the same random conversations: they answer alike, but for the listed differences.

The differences are those of docs/reference/protocol.md.
"""

from __future__ import annotations

import asyncio
import random
import struct
from typing import Any, TypeAlias

import pytest

from servolink.protocol import FrameParser
from servolink.testing import FakeBoard, run
from servolink.transports import create
from tests.firmware.conversations import MAGIC, conversation, frame
from tests.firmware.host import HostBoard, needs_compiler

pytestmark = needs_compiler

Answers: TypeAlias = list[tuple[int, bytes]]

_LENGTH = 25
_READY = frame(20030, bytes([255, 1, 1]))
_TO_ZERO = frame(20050, bytes([16]) + b"".join(struct.pack("<Bhh", servo, 0, 0) for servo in range(1, 17)))
_ALL_SERVOS = frame(20020, b"\xff")
_ROWS = {30011: 36, 30051: 36, 40011: 36, 30101: 35}
"""Responses with lists, whose order the document leaves open, and the length of a row."""


def _comparable(packet_id: int, content: bytes) -> tuple[int, object]:
    """Leave out what depends on the hardware, or on the order of a list."""
    if packet_id in {10031, 10041}:  # free memory, battery
        return packet_id, len(content)
    if packet_id == 20021:
        return packet_id, [(row[0], row[5], row[6]) for row in struct.iter_unpack("<BhhhhBB", content[1:])]
    if length := _ROWS.get(packet_id):
        return packet_id, sorted(content[2:][at : at + length] for at in range(0, len(content) - 2, length))
    return packet_id, content


def _is_listed(asked: bytes, virtual: Answers, firmware: Answers) -> bool:
    """Return whether a difference is one of those that are listed."""
    asked = asked[asked.rfind(MAGIC) :]
    packet_id = int.from_bytes(asked[4:6], "little")
    if packet_id == 10010:
        return (virtual, firmware) == ([(10011, b"\0")], [(10011, b"\1")])
    if packet_id in {20030, 20040}:
        is_odd = not (1 <= asked[8] <= 16 or asked[8] == 255) or max(asked[9:-1]) > 1
        return is_odd and len(virtual) == 1 and not firmware
    return False


def _moves_on_at_once(asked: bytes) -> bool:
    """Return whether a request moves a servo in no time and then again, a difference that is listed."""
    asked = asked[asked.rfind(MAGIC) :]
    if int.from_bytes(asked[4:6], "little") != 20050 or len(asked) % 5:  # no list of steps between 9 bytes and a sum
        return False
    steps = list(struct.iter_unpack("<Bhh", asked[9:-1]))
    jumps = [(at, servo) for at, (servo, _, interval) in enumerate(steps) if not interval]
    return any(servo == later[0] or 255 in {servo, later[0]} for at, servo in jumps for later in steps[at + 1 :])


class _Virtual:
    """Virtual board with a host, which may detach."""

    def __init__(self) -> None:
        self._fake = FakeBoard()
        self._received = b""

    def data(self, chunk: bytes) -> None:
        self._received += chunk

    def lost(self, error: Exception | None) -> None:
        pass

    async def attach(self) -> None:
        self._transport = create(self._fake.url)
        await self._transport.open(self)

    async def detach(self) -> None:
        await self._transport.close()

    async def ask(self, data: bytes, seconds: float) -> bytes:
        self._received = b""
        await self._transport.send(data)
        await asyncio.sleep(seconds)
        return self._received


async def _compare(board: HostBoard, seed: int) -> None:
    virtual = _Virtual()
    await virtual.attach()

    async def both(data: bytes, seconds: float) -> tuple[Answers, Answers]:
        board.receive(data)
        answers = (await virtual.ask(data, seconds), board.transmit() + board.run(seconds, 4000))
        one, other = ([(each[0], bytes(each[1])) for each in FrameParser().feed(sent)] for sent in answers)
        return one, other

    await both(_READY + _TO_ZERO, 3)
    is_comparable = True
    for asked, is_damaged in conversation(random.Random(seed), _LENGTH):
        one, other = await both(asked, 0.5)
        comparable = [[_comparable(*answer) for answer in answers] for answers in (one, other)]
        assert comparable[0] == comparable[1] or _is_listed(asked, one, other), (seed, asked.hex(), one, other)
        is_comparable &= not _moves_on_at_once(asked)
        if (10011, b"\0") in one:
            break  # the virtual board speaks the old protocol now
        if is_damaged:  # how long half a frame is kept is one of the differences
            await virtual.detach()
            board.detach()
            await virtual.attach()
    else:
        if is_comparable:
            _compare_angles(board, *await both(_ALL_SERVOS, 15))
    await virtual.detach()


def _compare_angles(board: HostBoard, virtual: Answers, firmware: Answers) -> None:
    """Compare where servos are in the end, if they have pulses and the angles are in range for both."""
    rows = [struct.iter_unpack("<BhhhhBB", answers[-1][1][1:]) for answers in (virtual, firmware)]
    for pulse, one, other in zip(board.pulses, *rows, strict=True):
        if pulse and abs(one[1]) <= 90 and abs(other[1]) <= 90:
            assert abs(one[1] - other[1]) <= 8, (one, other)  # corrections are up to 7 degrees apart


@pytest.mark.parametrize(
    ("first", "count"),
    [
        *((seed, 8) for seed in range(0, 100, 20)),
        *(pytest.param(at, 99, marks=pytest.mark.slow) for at in range(100, 10_000, 99)),
    ],
)
def test_the_firmware_answers_as_the_virtual_board_does(functions: Any, first: int, count: int) -> None:
    for seed in range(first, first + count):
        board = HostBoard(functions)
        run(_compare(board, seed))
        board.close()
