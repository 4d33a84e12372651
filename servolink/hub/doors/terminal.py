"""The door for programs that know only serial ports: a pseudo-terminal, with a name of its own if one is wanted.

A program begins when it opens the terminal and ends when it closes it. The next one finds a fresh session, and nothing
that its predecessor left unread.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from urllib.parse import quote

from servolink.hub.doors.lines import HIGH, LOW, MOST_UNREAD
from servolink.hub.engine.program import Program
from servolink.hub.hub import Hub
from servolink.listeners import RareWarning, linked_terminal
from servolink.motion.angles import AngleUnit
from servolink.platforms.pseudo_terminals import PseudoTerminal
from servolink.protocol.codec import Codec

_LOOK = 0.05  # seconds between looks for a program that has opened the terminal, of which the system tells nobody


@asynccontextmanager
async def pty_door(
    hub: Hub, *, link: str | Path | None = None, codec: Codec | None = None, unit: AngleUnit = "degree"
) -> AsyncIterator[str]:
    """Serve one program after the other on a new pseudo-terminal within this context; yield its URL.

    `link` is where a symbolic link to it is made, so that its name stays the same; one that a hub left there is
    replaced. Raise OpenError if the link cannot be made, TransportUnavailable on Windows.
    """
    with ExitStack() as stack:
        terminal = Terminal(hub, codec, unit)
        stack.callback(terminal.close)
        if link is None:
            yield f"serial://{terminal.name}"
        else:
            path = stack.enter_context(linked_terminal(Path.cwd() / link, terminal.name))
            yield f"serial://{quote(str(path))}"


class Terminal:
    """A pseudo-terminal, and the session of the program that has it open."""

    def __init__(self, hub: Hub, codec: Codec | None, unit: AngleUnit) -> None:
        """Make the terminal, and wait for a program to open it."""
        self._hub, self._codec = hub, codec
        self._unit: AngleUnit = unit
        self._loop = asyncio.get_running_loop()
        self._warning = RareWarning()
        self._program: Program | None = None
        self._unread = bytearray()
        self._timer: asyncio.TimerHandle | None = None
        self._terminal = PseudoTerminal()
        self.name = self._terminal.name
        """Where programs open it."""
        self._hang_up()

    def close(self) -> None:
        """End, and remove the terminal."""
        self._leave()
        if self._timer is not None:
            self._timer.cancel()
        self._terminal.close()

    # --- coming and going ---------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Begin a session if a program has opened the terminal."""
        data = self._terminal.read()
        if data is None:
            self._timer = self._loop.call_later(_LOOK, self._look)
            return
        self._timer = None
        program = self._program = self._hub.join(
            self._send, who=f"serial port {self.name}", door="pty", codec=self._codec, unit=self._unit
        )
        program.on_room = lambda: self._terminal.on_readable(self._readable)
        self._terminal.on_readable(self._readable)
        self._receive(program, data)

    def _hang_up(self) -> None:
        """End the session, and make the terminal as new."""
        self._leave()
        self._terminal.renew()
        self._timer = self._loop.call_later(_LOOK, self._look)

    def _leave(self) -> None:
        self._terminal.on_readable(None)
        self._terminal.on_writable(None)
        self._unread.clear()
        if self._program is not None:
            self._program.leave()
            self._program = None

    # --- bytes --------------------------------------------------------------------------------------------------

    def _readable(self) -> None:
        data = self._terminal.read()
        if data is None or self._program is None:
            self._hang_up()
        else:
            self._receive(self._program, data)

    def _receive(self, program: Program, data: bytes) -> None:
        program.receive(data)
        if program.is_full:
            self._terminal.on_readable(None)

    def _send(self, frames: bytes) -> None:
        if len(self._unread) + len(frames) > MOST_UNREAD:
            self._warning.log("%s: responses are dropped, as the program does not read them", self.name)
            return
        if not self._unread:
            self._loop.call_soon(self._flush)
        self._unread += frames
        if len(self._unread) > HIGH and self._program is not None:
            self._program.pause()

    def _flush(self) -> None:
        if self._program is None:
            return
        written = self._terminal.write(self._unread)
        if not written and self._terminal.is_closed():  # found out here only if the program is not read, as it is full
            self._hang_up()
            return
        del self._unread[:written]
        if self._program.queue.is_unread and len(self._unread) < LOW:
            self._program.resume()
        if self._unread:
            self._terminal.on_writable(self._flush)
        else:
            self._terminal.on_writable(None)
