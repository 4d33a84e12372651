"""Door for programs that know only serial ports: a pseudo-terminal, with a lasting link.

The session of a program begins when the terminal is opened, and ends when the terminal is closed.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

from servolink.hub.engine.program import FrameProgram
from servolink.hub.hub import Hub
from servolink.listeners.pty import ServedTerminal, address_of
from servolink.motion.angles import AngleUnit
from servolink.protocol.codec import Codec


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

    with closing(ServedTerminal(begin)) as terminal, address_of(terminal, link) as url:
        yield url
