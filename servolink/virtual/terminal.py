"""A pseudo-terminal: to a host it is a serial port."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from io import FileIO

from servolink.errors import TransportUnavailable
from servolink.virtual.bridge import Connect, bridge, end

AVAILABLE = sys.platform != "win32"
"""Whether this system has pseudo-terminals."""


@asynccontextmanager
async def serve_terminal(connect: Connect) -> AsyncIterator[str]:
    """Serve one conversation over a new pseudo-terminal and give its URL.

    Like a board on a serial line it does not notice when hosts come and go.
    """
    if sys.platform == "win32":
        raise TransportUnavailable("pseudo-terminals do not exist on Windows; serve the board over TCP")
    import tty

    ours, theirs = os.openpty()
    with ExitStack() as line:
        # Their end is held as long as ours: without it the line goes down, and loses its raw mode, when a host
        # closes it.
        line.callback(os.close, theirs)
        source = line.enter_context(open(ours, "rb", buffering=0))
        sink = line.enter_context(open(os.dup(ours), "wb", buffering=0))
        tty.setraw(theirs)
        name = os.ttyname(theirs)
        reader, writer = await _streams(source, sink, line)
        serving = asyncio.ensure_future(bridge(reader, writer, connect, patient=True))
        serving.add_done_callback(lambda _: line.close())
        try:
            yield f"serial://{name}"
        finally:
            serving.cancel()
            await asyncio.wait((serving,))


async def _streams(source: FileIO, sink: FileIO, line: ExitStack) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Return streams on two files; closing `line` ends them."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    upward, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), source)
    line.callback(upward.close)
    unread = asyncio.StreamReader()
    downward, protocol = await loop.connect_write_pipe(lambda: asyncio.StreamReaderProtocol(unread), sink)
    line.callback(end, downward)
    return reader, asyncio.StreamWriter(downward, protocol, None, loop)
