"""`connect`: from an address to a board."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Generator
from types import TracebackType
from typing import Any

from servolink.client.board import Board
from servolink.client.session import FIRST_PAUSE, LONGEST_PAUSE, check_count, check_timeout
from servolink.connection.connection import Connection
from servolink.connection.stats import Stats
from servolink.discovery.names import resolve_url
from servolink.errors import ConnectionLost, OpenError, RequestTimeout, TransportUnavailable
from servolink.escaping import quote
from servolink.motion import AngleLimits, AngleUnit, MotionLimits
from servolink.protocol.codec import Codec
from servolink.protocol.frame import ByteOrder
from servolink.transports.base import Transport
from servolink.transports.registry import create
from servolink.transports.serial_ports import PortTracker


class connect:  # noqa: N801 - reads as the function it stands for
    """`async with connect(url) as board:` opens a board and closes it again; `await connect(url)` only opens it.

    `url` is an address (`serial:///dev/ttyACM0`, `tcp://host:port`, `virtual://`), a device path, a name given by
    `servolink use`, or a transport; without one it is the only board that `discover` finds.
    `timeout` is the time in seconds for one answer, `retries` how often a query is repeated, `window` how many
    requests may be on the line at once (1 unless the board queues). `angle_unit` is set on all servos before the
    first command with an angle; None leaves them alone. `angle_limits` (degrees) and `speed_cap` (degrees per
    second) are checked before anything moves. With `reconnect` a lost connection comes back by itself, to the same
    board; what waited for it has failed, and nothing moves again unless asked (see `Board.states`). Raises OpenError
    or TransportUnavailable, which say what to do.
    """

    def __init__(
        self,
        url: str | Transport | None = None,
        *,
        byte_order: ByteOrder = "little",
        caption_encoding: str = "utf-8",
        timeout: float = 1.0,
        retries: int = 2,
        window: int = 1,
        angle_unit: AngleUnit | None = "degree",
        angle_limits: AngleLimits | None = None,
        speed_cap: float | None = None,
        reconnect: bool = False,
    ) -> None:
        """Check the arguments; nothing is opened yet."""
        check_timeout(timeout)
        check_count("retries", retries, 0)
        check_count("window", window, 1)
        if angle_unit not in ("degree", "adc", None):
            raise ValueError(f"angle_unit: {angle_unit!r} is none of 'degree', 'adc' and None")
        if not (url is None or isinstance(url, str | Transport)):
            raise TypeError(f"url: {quote(url)} is {type(url).__name__}; give an address as text, a transport or None")
        if reconnect:
            _refuse_transport(url, "reconnect")
        self._url = url
        self._reconnect = reconnect
        self._codec = Codec(byte_order, caption_encoding)
        self._timeout, self._retries, self._window = timeout, retries, window
        self._angle_unit: AngleUnit | None = angle_unit
        self._limits = MotionLimits(angle_limits, speed_cap)
        self._board: Board | None = None
        self._before: Connection | None = None  # the latest link to this board

    async def open(self) -> Board:
        """Open the board."""
        url = self._url
        if url is not None and not isinstance(url, str):
            return Board(await self._open_link(url, Stats()), self._angle_unit, self._limits)
        address = await resolve_url(url)
        stats = Stats()
        link = await self._open_link(create(address), stats)
        if not self._reconnect:
            return Board(link, self._angle_unit, self._limits)
        whereabouts = PortTracker(address)

        async def reopen() -> Connection:
            return await self._open_link(create(await whereabouts.url()), stats)

        board = Board(link, self._angle_unit, self._limits, reopen)
        try:
            await whereabouts.learn()
            await board.project_id()  # by which it is known again
        except BaseException as error:
            await board.close()
            if isinstance(error, RequestTimeout):
                raise OpenError(str(error)) from error
            raise
        return board

    async def _open_link(self, transport: Transport, stats: Stats) -> Connection:
        link = Connection(
            transport,
            self._codec,
            timeout=self._timeout,
            retries=self._retries,
            window=self._window,
            stats=stats,
            before=self._before,
        )
        await link.open()
        self._before = link
        return link

    def __await__(self) -> Generator[Any, None, Board]:
        """Open the board; close it yourself."""
        return self.open().__await__()

    async def __aenter__(self) -> Board:
        """Open the board."""
        self._board = await self.open()
        return self._board

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the board."""
        if self._board is not None:
            await self._board.close()


def _refuse_transport(url: object, name: str) -> None:
    if not (url is None or isinstance(url, str)):
        raise ValueError(f"{name}: a transport is opened once; give an address")


async def reconnecting(url: str | None = None, **options: Any) -> AsyncGenerator[Board, None]:
    """Yield a newly connected board, and another one each time the `async for` comes round.

    Leave the body by `continue` after ConnectionLost, and the loop by `break`; `contextlib.aclosing` around it closes
    the last board at once. Takes an address and the options of `connect`; waits 0.1 to 5 s before each further board,
    longer each time until one has answered.
    """
    _refuse_transport(url, "reconnecting")
    pause = FIRST_PAUSE
    before: Connection | None = None
    while True:
        connecting = connect(url, **options)
        connecting._before = before  # noqa: SLF001 - nobody else follows a connection with another
        try:
            async with connecting as board:
                yield board
            if board.stats.round_trips:
                pause = FIRST_PAUSE
        except TransportUnavailable:
            raise  # no waiting makes a wrong address right
        except (OpenError, ConnectionLost):
            pass  # not there yet
        before = connecting._before  # noqa: SLF001 - likewise
        await asyncio.sleep(pause)
        pause = min(2 * pause, LONGEST_PAUSE)
