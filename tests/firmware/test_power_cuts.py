"""Imports that lose the power of the board: no confirmed change is lost, and `apply` again ends them."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from servolink.client import connect
from servolink.errors import ServolinkError
from servolink.protocol import FrameParser, encode_frame
from tests.firmware.conversations import frame
from tests.firmware.host import HostBoard, HostTransport, needs_compiler
from tests.firmware.test_flash import stored
from tests.project.pulled import NEW, OLD
from tests.sampling import every
from tests.virtual_time import run

pytestmark = needs_compiler

_NO_RESPONSE = {10050, 20050, 20060}


class _Line(HostTransport):
    """Line to a board that loses power `after` some seconds, with all requests and responses."""

    _board: HostBoard

    def __init__(self, board: HostBoard, after: float | None = None, bits: int = 0) -> None:
        super().__init__(board)
        self._after, self._bits = after, bits
        self._asked, self._answered = FrameParser(), FrameParser()
        self.requests = list[bytes]()
        self.responses = 0
        self.opened_at = self.closed_at = 0.0
        self.was_busy = False
        """Whether flash was erased or programmed when power was lost."""

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        self.opened_at = loop.time()
        if self._after is not None:
            loop.call_later(self._after, self._lose_power)
        await super()._open()

    async def _close(self) -> None:
        self.closed_at = asyncio.get_running_loop().time()
        await super()._close()

    def _send(self, data: bytes) -> None:
        self.requests += [encode_frame(*each, "little") for each in self._asked.feed(data)]
        super()._send(data)

    def _deliver(self, data: bytes) -> None:
        self.responses += len(self._answered.feed(data))
        super()._deliver(data)

    def _lose_power(self) -> None:
        if self._stage != "open":
            return
        self._board.tick(round(asyncio.get_running_loop().time() * 1e6))
        self.responses += len(self._answered.feed(self._board.transmit()))
        self.was_busy = self._board.is_busy
        self._board.cut_power(self._bits)
        self._lose(ConnectionAbortedError("the power is off"))

    def allowed(self, board: HostBoard) -> Iterator[dict[str, bytes]]:
        """Yield the states that may be left: those of `board`, as it was, after each request from the confirmed on."""
        confirmed = self.responses
        for request in self.requests:
            if confirmed <= 0:
                yield stored(board)
            board.ask(request, 30)
            confirmed -= int.from_bytes(request[4:6], "little") not in _NO_RESPONSE
        yield stored(board)


@dataclass
class _Import:
    """Import of the new project to a board with the old one."""

    start: HostBoard
    is_replaced: bool
    seconds: float = 0.0
    """Duration if nothing interrupts it."""

    async def apply(self, line: _Line, folder: Path) -> None:
        async with connect(line) as board:
            await board.apply_project(NEW, replace=self.is_replaced, folder=folder)


def _fill(board: HostBoard) -> HostBoard:
    """Return a board with the same records, whose bank of flash has room for a few changes more."""
    long = frame(30030, (200).to_bytes(4, "little") + bytes(32) + (5900).to_bytes(2, "little") + b"\1\0\0\0\0" * 5900)
    for request in (long, long, long, frame(30040, (200).to_bytes(4, "little"))):
        assert board.ask(request, 30)[8:-1] == b"\1"
    change = frame(30120, OLD.project_id.to_bytes(4, "little"))
    room, twin = 0, board.copy()
    while not sum(twin.fields.erases):  # of the bank that was left
        assert twin.ask(change, 30)
        room += 1
    for _ in range(room - 6):
        assert board.ask(change, 30)
    return board.copy()


async def _imports(functions: Any, folder: Path) -> list[_Import]:
    """Return imports by differences and as a whole, to boards whose flash is nearly blank and nearly full."""
    blank = HostBoard(functions)
    async with connect(HostTransport(blank)) as board:
        await board.apply_project(OLD, folder=folder)
    found = [_Import(start, whole) for start in (blank.copy(), _fill(blank)) for whole in (False, True)]
    for number, each in enumerate(found):
        line = _Line(each.start.copy())
        await each.apply(line, folder / str(number))
        each.seconds = line.closed_at - line.opened_at
    return found


async def _cut(imported: _Import, draw: random.Random, folder: Path) -> bool:
    """Cut the power at a random instant of an import; return whether flash was busy."""
    host = imported.start.copy()
    line = _Line(host, draw.random() * imported.seconds, draw.randrange(2**32))
    with suppress(ServolinkError):
        await imported.apply(line, folder)
    oracle = imported.start.copy()
    assert stored(host) in line.allowed(oracle), "a confirmed change is lost, or one is there in part"
    await imported.apply(_Line(host), folder)
    async with connect(HostTransport(host)) as board:
        assert await board.export_project() == NEW
    oracle.close()
    host.close()
    return line.was_busy


@every(25)
def test_no_confirmed_change_is_lost_and_apply_again_ends_it(functions: Any, tmp_path: Path, step: int) -> None:
    draw = random.Random(9)
    imports = run(_imports(functions, tmp_path / "whole"))
    busy = [run(_cut(imports[number % len(imports)], draw, tmp_path / str(number))) for number in range(300 // step)]
    assert 0 < sum(busy) < len(busy), "some cuts are in the middle of what flash does, some are not"
