"""The door for programs in any language: the board's own protocol over TCP."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from servolink.control.roles import Role
from servolink.escaping import quote
from servolink.hub.doors.lines import Line, serve_lines
from servolink.hub.hub import Hub
from servolink.listeners import RareWarning, host_and_port, listening_sockets, most_connections, place_of
from servolink.motion.angles import AngleUnit
from servolink.protocol.codec import Codec
from servolink.protocol.frame import MAGIC
from servolink.transports.stream import keep_alive

_SHOWN = 16  # bytes of what something else began with


@asynccontextmanager
async def tcp_door(
    hub: Hub, place: str, *, role: Role = Role.EDIT, codec: Codec | None = None, unit: AngleUnit = "degree"
) -> AsyncIterator[str]:
    """Serve programs at `place`, HOST:PORT, within this context; yield the URL. Port 0 takes a free one.

    Everybody who can connect there may do what `role` allows. A connection that does not begin with a frame is closed
    before anything in it is used. Raise TransportUnavailable or OpenError if the place is wrong or cannot be had.
    """
    door = "watch-tcp" if role is Role.WATCH else "tcp"
    warning = RareWarning()

    def make() -> TcpLine:
        return TcpLine(hub, door, role, codec, unit, warning)

    listening = await listening_sockets(*host_and_port(place))
    url = f"tcp://{place_of(listening)}"
    async with serve_lines(listening, make, most=most_connections()):
        yield url


class TcpLine(Line):
    """A TCP connection, which becomes a program with its first frame."""

    def __init__(
        self, hub: Hub, door: str, role: Role, codec: Codec | None, unit: AngleUnit, warning: RareWarning
    ) -> None:
        """Join `hub` once the connection has begun as this protocol does, else log `warning`."""
        super().__init__()
        self._hub = hub
        self._door, self._role, self._codec = door, role, codec
        self._unit: AngleUnit = unit
        self._warning = warning
        self._first = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Make the system notice a program that is silently gone."""
        super().connection_made(transport)
        connection: socket.socket = transport.get_extra_info("socket")
        keep_alive(connection, idle=60, interval=15, count=4)

    @property
    def _who(self) -> str:
        host, port = (self._pipe.get_extra_info("peername") or ("", ""))[:2] if self._pipe is not None else ("", "")
        return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"

    def _begin(self, data: bytes) -> None:
        # A web page can make the browser connect to any port of this machine. What it sends behind its line of HTTP
        # must not be searched for frames.
        self._first += data
        if not MAGIC.startswith(self._first[: len(MAGIC)]):
            shown = quote(self._first[:_SHOWN])
            self._warning.log("%s was disconnected: it began with %s, not as this protocol does", self._who, shown)
            self.abort("")
        elif len(self._first) >= len(MAGIC):
            program = self._hub.join(
                self.send, who=self._who, door=self._door, role=self._role, codec=self._codec, unit=self._unit
            )
            self._joined(program)
            self._receive(self._first)
