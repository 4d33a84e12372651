"""The door for programs that know only serial ports: a pseudo-terminal, with a name of its own if one is wanted.

A program begins when it opens the terminal and ends when it closes it. The next one finds a fresh session.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

from servolink.hub.engine.program import Program
from servolink.hub.hub import Hub
from servolink.listeners.pty import ServedTerminal, address_of
from servolink.motion.angles import AngleUnit
from servolink.protocol.codec import Codec


@asynccontextmanager
async def pty_door(
    hub: Hub, *, link: str | Path | None = None, codec: Codec | None = None, unit: AngleUnit = "degree"
) -> AsyncIterator[str]:
    """Serve one program after the other on a new pseudo-terminal within this context; yield its URL.

    `link` is where a symbolic link to it is made, so that its name stays the same; one that a hub left there is
    replaced. Raise OpenError if the link cannot be made, TransportUnavailable on Windows.
    """

    def begin(terminal: ServedTerminal) -> Program:
        return hub.join(terminal.send, who=f"serial port {terminal.name}", door="pty", codec=codec, unit=unit)

    with closing(ServedTerminal(begin)) as terminal, address_of(terminal, link) as url:
        yield url
