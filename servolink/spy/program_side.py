"""Pseudo-terminal or TCP port for a program in place of the board, one program at a time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, closing, contextmanager
from pathlib import Path

from servolink.listeners.accepted import AcceptedConnection, serve_connections
from servolink.listeners.pty import ServedTerminal, address_of
from servolink.listeners.tcp import listening_sockets, place_of
from servolink.spy.relay import Relay

_NO_BOARD = (b"GET ", b"HEAD ", b"POST ", b"PUT ", b"DELETE ", b"OPTIONS ", b"PATCH ", b"CONNECT ", b"\x16\x03")
"""First bytes of browsers: any web page can make a browser connect to the port and send frames to the board."""
_LOOK = 0.01  # seconds between looks for a program, whose first bytes wait meanwhile


@contextmanager
def on_terminal(
    relay: Relay, link: str | Path | None, baudrate: int, on_baudrate: Callable[[int], object]
) -> Iterator[str]:
    """Serve programs on a new pseudo-terminal within this context, linked at `link` unless None; yield the URL.

    Programs find this baud rate; `on_baudrate` is called with each other rate that one sets. Raise OpenError if the
    link cannot be made, TransportUnavailable on Windows.
    """
    terminal = ServedTerminal(
        lambda each: relay.join(each.send), high=0, low=0, look=_LOOK, baudrate=baudrate, on_baudrate=on_baudrate
    )
    relay.sink = terminal.send  # which looks for a program first
    with closing(terminal), address_of(terminal, link) as url:
        yield url


@asynccontextmanager
async def on_network(relay: Relay, host: str, port: int) -> AsyncIterator[str]:
    """Serve programs at a TCP port within this context; yield the URL. Raise OpenError if the port is not available."""
    listening = await listening_sockets(host, port)
    async with serve_connections(listening, lambda: _Connection(relay)):
        yield f"tcp://{place_of(listening)}"


class _Connection(AcceptedConnection):
    """Connection of the present program; others are refused meanwhile."""

    def __init__(self, relay: Relay) -> None:
        super().__init__(high=0, low=0)
        self._relay = relay
        self._is_checked = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if self._relay.has_program:
            self.abort()
        else:
            self._join(self._relay.join(self.send), must_read=False)  # the board waits for the program

    def _begin(self, data: bytes) -> None:
        """Ignore the bytes of a refused program."""

    def _receive(self, data: bytes) -> None:
        if not self._is_checked and data.startswith(_NO_BOARD):
            self.abort()
            return
        self._is_checked = True
        super()._receive(data)
