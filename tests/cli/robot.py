"""A virtual board in this process and in virtual time, behind `virtual://`, with somebody beside it.

Commands run as they do in a shell, but a move of minutes takes no time, and what is done to the board meanwhile is
done at its second however busy the machine is.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, TypeVar

import pytest

from servolink.cli.developers.virtual import _apply
from servolink.client import Board, connect
from servolink.errors import OpenError
from servolink.transports import Address, Faults, Transport
from servolink.virtual import FaultyVirtualTransport, VirtualBoard, VirtualTransport, parse_script
from tests.cli.programs import Said, call
from tests.virtual_time import VirtualClock

T = TypeVar("T")


def typing(texts: Sequence[str | Callable[[], object]]) -> Callable[..., AbstractContextManager[bool]]:
    """Return a stand-in for `single_keys` in which a text is typed, or something done, every half second."""

    @contextmanager
    def keys(typed: Callable[[str], None]) -> Iterator[bool]:
        loop = asyncio.get_running_loop()
        for number, text in enumerate(texts, 1):
            loop.call_later(number / 2, functools.partial(typed, text) if isinstance(text, str) else text)
        yield True

    return keys


class Robot:
    """Commands on one board, one after the other."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.board = VirtualBoard(3)
        self.faults = Faults()
        self._capsys = capsys
        self._deeds: list[tuple[float, Callable[[], object]]] = []
        self._others: list[asyncio.Task[None]] = []
        self._line: VirtualTransport | None = None
        self._plugged_in = True
        self.clock = VirtualClock()

    def at(self, seconds: float, act: Callable[[], object]) -> None:
        """Do something that many seconds after the next command has opened the line."""
        self._deeds.append((seconds, act))

    def script(self, text: str) -> None:
        """Do what a script for `servolink virtual` says."""
        for deed in parse_script(text):
            self.at(deed.at, functools.partial(_apply, self.board, deed))

    def unplug(self) -> None:
        """Take the board away."""
        self._plugged_in = False
        assert self._line is not None
        self._line.unplug()

    def plug_in(self) -> None:
        """Bring it back."""
        self._plugged_in = True

    def __call__(self, *arguments: str) -> Said:
        """Run a command on it."""
        return call(self._capsys, "--url", "virtual://", *arguments)

    def ask(self, question: Callable[[Board], Awaitable[T]]) -> T:
        """Ask the board between two commands."""

        async def main() -> T:
            async with connect(VirtualTransport(self.board)) as board:
                return await question(board)

        return self.clock.run(main())

    def meanwhile(self, work: Callable[[Board], Awaitable[object]]) -> None:
        """Let somebody else work on the board while a command runs."""

        async def main() -> None:
            async with connect(VirtualTransport(self.board)) as board:
                await work(board)

        self._others.append(asyncio.get_running_loop().create_task(main()))

    def line(self, address: Address) -> Transport:
        """Lead to the board, as `virtual://` does."""
        self._line = _Line(self, address)
        if self.faults == Faults():
            return self._line
        return FaultyVirtualTransport(self._line, self.faults, seed=3)

    def opened(self) -> None:
        """Begin with what is to be done; OpenError if the board is away."""
        if not self._plugged_in:
            raise OpenError("there is no board")
        deeds, self._deeds = self._deeds, []
        for seconds, act in deeds:
            asyncio.get_running_loop().call_later(seconds, act)


class _Line(VirtualTransport):
    def __init__(self, robot: Robot, address: Address) -> None:
        super().__init__(robot.board, address.url)
        self._robot = robot

    async def open(self, receiver: Any) -> None:
        self._robot.opened()
        await super().open(receiver)
