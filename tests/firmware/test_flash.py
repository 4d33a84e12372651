"""Records in flash: nothing that was confirmed is lost, whenever power is."""

from __future__ import annotations

import random
from typing import Any

import pytest

from servolink.protocol import FrameParser
from tests.firmware.conversations import PACKETS, content, frame
from tests.firmware.host import FLASH, HostBoard, needs_compiler
from tests.sampling import every

pytestmark = needs_compiler

_CHANGES = {
    30030: 0.5,
    30040: 0.1,
    30070: 0.2,
    30080: 0.1,
    30110: 0.1,
    30120: 0.1,
    40030: 0.1,
    40050: 0.05,
    10020: 0.01,
}
_LISTS = {30010: 30020, 30050: 30060, 40010: 40020}
"""Requests for lists, and for one of its records."""


def _answer(board: HostBoard, request: bytes) -> bytes:
    sent = board.ask(request, 30)
    ((_, answer),) = ((each[0], each[1]) for each in FrameParser().feed(sent))
    return bytes(answer)


def stored(board: HostBoard) -> dict[str, bytes]:
    """Return all that a board has stored."""
    found = {str(packet_id): _answer(board, frame(packet_id)) for packet_id in (30100, 30130, 40060)}
    for listing, query in _LISTS.items():
        rows = _answer(board, frame(listing))[2:]
        for at in range(0, len(rows), 36):
            record_id = rows[at : at + 4]
            found[f"{query} {record_id.hex()}"] = _answer(board, frame(query, record_id))
    return found


def _change(draw: random.Random) -> bytes:
    (packet_id,) = draw.choices(list(_CHANGES), list(_CHANGES.values()))
    parts = content(draw, PACKETS[packet_id]["fields"], odd=0)
    if packet_id == 30030 and draw.random() < 0.5:  # a long one, which fills the flash
        count = draw.randrange(1, 6000)
        parts = parts[:36] + count.to_bytes(2, "little") + draw.randbytes(4 * count).ljust(5 * count, b"\0")
        parts = b"".join([parts[:38], *(parts[at : at + 4] + b"\0" for at in range(38, len(parts), 5))])
    return frame(packet_id, parts)


@every(10)
def test_a_power_cut_leaves_the_state_before_or_after_a_change(functions: Any, step: int) -> None:
    draw = random.Random(5)
    board = HostBoard(functions)
    before = stored(board)
    outcomes = set[str]()
    for _ in range(300 // step):
        for _ in range(draw.randrange(8)):  # these are confirmed
            assert _answer(board, _change(draw))
            before = stored(board)
        change = _change(draw)
        twin = board.copy()
        _answer(twin, change)
        after = stored(twin)
        twin.close()
        board.receive(change)
        for _ in range(draw.choice([1, 3, 10, 100, 1000])):
            board.tick(board.fields.now + draw.randrange(1, 400))
        is_confirmed = bool(board.transmit())
        board.cut_power(draw.randrange(2**32))
        found = stored(board)
        assert found == after or (found == before and not is_confirmed)
        outcomes.add("after" if is_confirmed else "before" if found == before else "between")
        before = found
    assert {"after", "before"} <= outcomes
    assert sum(board.fields.erases) >= FLASH // 4096 // 2, "the banks were never exchanged"
    board.close()


def test_a_cut_change_is_there_as_a_whole_or_not_at_all(board: HostBoard) -> None:
    board.run(1)
    old = frame(30030, (5).to_bytes(4, "little") + b"old".ljust(32, b"\0") + bytes(2))
    new = frame(30030, (5).to_bytes(4, "little") + b"new".ljust(32, b"\0") + bytes(2))
    query = frame(30020, (5).to_bytes(4, "little"))
    for microseconds in range(0, 3000, 100):
        assert _answer(board, old) == b"\1"
        board.receive(new)
        for _ in range(microseconds // 100):
            board.tick(board.fields.now + 100)
        was_told = bool(board.transmit())
        board.cut_power(microseconds)
        caption = _answer(board, query)[4:7]
        assert caption == b"new" if was_told else caption in {b"old", b"new"}


def test_a_response_is_sent_when_its_change_is_in_flash(board: HostBoard) -> None:
    board.run(1)
    board.receive(frame(30120, (77).to_bytes(4, "little")))
    assert board.transmit() == b""
    board.cut_power(0)
    assert _answer(board, frame(30130)) == bytes(4)
    assert _answer(board, frame(30120, (77).to_bytes(4, "little"))) == b"\1"
    board.cut_power(0)
    assert _answer(board, frame(30130)) == (77).to_bytes(4, "little")


def test_a_full_memory_refuses_records_and_still_deletes(board: HostBoard) -> None:
    board.run(1)
    added = 0
    while _answer(board, frame(30030, (added + 1).to_bytes(4, "little") + bytes(32) + bytes(2))) == b"\1":
        added += 1
    assert added == 65536 // 64
    listing = _answer(board, frame(30010))
    assert len(listing) == 2 + 36 * added
    assert _answer(board, frame(30040, (1).to_bytes(4, "little"))) == b"\1"
    board.cut_power(0)
    assert len(_answer(board, frame(30010))) == 2 + 36 * (added - 1)


@pytest.mark.parametrize("noise", [b"", b"\0" * 16, b"\x53" + b"\xff" * 15])
def test_flash_with_anything_in_it_is_an_empty_board(functions: Any, noise: bytes) -> None:
    board = HostBoard(functions)
    draw = random.Random(1)
    for at in range(0, FLASH, 16):
        for offset, byte in enumerate(noise or draw.randbytes(16)):
            board.fields.flash[at + offset] = byte
    board.cut_power(0)
    assert _answer(board, frame(30010)) == bytes(2)
    assert _answer(board, frame(30120, (1).to_bytes(4, "little"))) == b"\1"
    board.close()
