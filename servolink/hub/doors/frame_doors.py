"""Doors for programs that speak the board's own protocol: over TCP, and over a pseudo-terminal with a lasting link.

A session over TCP begins with the first frame. One on a pseudo-terminal lasts while the terminal is open.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing
from functools import partial
from pathlib import Path

from servolink.control import Role
from servolink.errors import quote
from servolink.hub.engine.program import FrameProgram
from servolink.hub.hub import Hub
from servolink.motion import AngleUnit
from servolink.protocol import MAGIC, Codec
from servolink.transports import AcceptedConnection, NetworkPlace, RareWarning, ServedTerminal, Strangers

_SHOWN = 16  # bytes of a wrong beginning


@asynccontextmanager
async def tcp_door(
    hub: Hub, place: str, *, role: Role = Role.EDIT, codec: Codec | None = None, unit: AngleUnit = "degree"
) -> AsyncIterator[str]:
    """Serve programs at `place`, HOST:PORT, within this context; yield the URL. Port 0 takes a free port.

    Everybody who can connect there has `role`. A connection that does not begin with a frame is closed before any byte
    is used. Raise TransportUnavailable for a wrong place, OpenError for one that is not available.
    """
    join = partial(hub.join, door="watch-tcp" if role is Role.WATCH else "tcp", role=role, codec=codec, unit=unit)
    warning = RareWarning()
    listening = await NetworkPlace.parse(place).listen()
    url = f"tcp://{NetworkPlace.of(listening)}"
    async with AcceptedConnection.serving(
        listening, lambda: TcpConnection(join, warning), most=Strangers.most_connections()
    ):
        yield url


class TcpConnection(AcceptedConnection):
    """TCP connection, which becomes a program with the first frame."""

    def __init__(self, join: Callable[..., FrameProgram], warning: RareWarning) -> None:
        """Call `join`, made of `Hub.join`, at the first frame; log `warning` at any other beginning."""
        super().__init__()
        self._join_hub = join
        self._warning = warning
        self._first = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Name the program by its address."""
        super().connection_made(transport)
        host, port, *_ = transport.get_extra_info("peername") or ("", 0)  # none if it has gone already
        self.who = str(NetworkPlace(host, port))

    def _begin(self, data: bytes) -> None:
        # A web page can make the browser connect to any port of this machine: no frames are searched behind HTTP.
        self._first += data
        if not MAGIC.startswith(self._first[: len(MAGIC)]):
            shown = quote(self._first[:_SHOWN])
            self._warning.log("%s was disconnected: its first bytes are %s, not of this protocol", self.who, shown)
            self.abort()
        elif len(self._first) >= len(MAGIC) and not self.admit():
            self.abort()
        elif len(self._first) >= len(MAGIC):
            program = self._join_hub(self.send, who=self.who)
            program.on_end = self.end
            self._join(program)
            self._receive(self._first)


@asynccontextmanager
async def pty_door(
    hub: Hub, *, link: str | Path | None = None, codec: Codec | None = None, unit: AngleUnit = "degree"
) -> AsyncIterator[str]:
    """Serve programs, in turn, on a new pseudo-terminal within this context; yield the URL.

    `link` is the path of a symbolic link to the terminal, whose name differs each time; a link that a killed hub left
    is replaced. Raise OpenError if the link cannot be made, TransportUnavailable on Windows.
    """

    def begin(terminal: ServedTerminal) -> FrameProgram:
        return hub.join(terminal.send, who=f"serial port {terminal.name}", door="pty", codec=codec, unit=unit)

    with closing(ServedTerminal(begin)) as terminal, terminal.address(link) as url:
        yield url
