"""Board: the 32 commands of the protocol as a person would say them, and `connect`, which gives one."""

from __future__ import annotations

from collections.abc import Generator
from types import TracebackType
from typing import Any

from servolink.client.angles import AngleUnit
from servolink.client.link import Link
from servolink.client.motion import AngleLimits, MotionLimits
from servolink.client.read_back import ReadBack
from servolink.client.servos import Servos
from servolink.client.settings import Settings
from servolink.client.stats import Stats
from servolink.discovery.resolve import resolved
from servolink.protocol.codec import Codec
from servolink.protocol.frame import ByteOrder
from servolink.transports.base import Transport
from servolink.transports.registry import create


class Board(Settings, Servos, ReadBack):
    """A connected board; one file per chapter of the document holds its commands."""

    @property
    def url(self) -> str:
        """The address of the board."""
        return self._link.transport.url

    @property
    def stats(self) -> Stats:
        """What the link has seen: frames, bytes, noise, late answers, round trips."""
        return self._link.stats

    async def close(self) -> None:
        """End the button events and free the port; may be called again."""
        try:
            await self._events.close()
        finally:
            await self._link.close()


class connect:  # noqa: N801 - reads as the function it stands for
    """`async with connect(url) as board:` opens a board and closes it again; `await connect(url)` only opens it.

    `url` is an address (`serial:///dev/ttyACM0`, `tcp://host:port`, `virtual://`), a device path, a name given by
    `servolink use`, or a transport; without one it is the only board that `discover` finds.
    `timeout` is the time in seconds for one answer, `retries` how often a query is repeated, `window` how many
    requests may be on the line at once (1 unless the board queues). `angle_unit` is set on all servos before the
    first command with an angle; None leaves them alone. `angle_limits` (degrees) and `speed_cap` (degrees per
    second) are checked before anything moves. Raises OpenError or TransportUnavailable, which say what to do.
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
    ) -> None:
        """Check the arguments; nothing is opened yet."""
        for name, value, least in (("timeout", timeout, 0.001), ("retries", retries, 0), ("window", window, 1)):
            if not value >= least:
                raise ValueError(f"{name}: {value!r} is below {least}")
        self._url = url
        self._codec = Codec(byte_order, caption_encoding)
        self._timeout, self._retries, self._window = timeout, retries, window
        self._angle_unit: AngleUnit | None = angle_unit
        self._limits = MotionLimits(angle_limits, speed_cap)
        self._board: Board | None = None

    async def open(self) -> Board:
        """Open the board."""
        url = self._url
        transport = create(await resolved(url)) if url is None or isinstance(url, str) else url
        link = Link(transport, self._codec, timeout=self._timeout, retries=self._retries, window=self._window)
        await link.open()
        return Board(link, self._angle_unit, self._limits)

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
