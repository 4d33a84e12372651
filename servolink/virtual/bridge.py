"""Carries bytes between a stream and a transport, both ways, until one of them ends."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from servolink.errors import TransportError
from servolink.transports.base import Transport

Connect = Callable[[], Transport]
"""Makes a new connection to the board that is served."""
MOST_WAITING = 1024 * 1024
"""Bytes that may wait for a host to read them."""

_CHUNK = 4096
_LINGER = 1.0  # seconds for a host to read what it was sent before it closed


async def bridge(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, connect: Connect, *, patient: bool = False
) -> None:
    """Carry bytes until the stream or the transport ends, then close both.

    A host that does not read is not heard until it does, and disconnected when too much waits for it. With
    `patient`, for lines that cannot tell whether anybody is there, it is heard, and what has no room is lost.
    """
    transport = connect()
    mouth = _Mouth(writer, patient=patient)
    try:
        await transport.open(mouth)
        reading = asyncio.ensure_future(_read(reader, writer, transport, patient=patient))
        try:
            await asyncio.wait((reading, mouth.ended), return_when=asyncio.FIRST_COMPLETED)
        finally:
            reading.cancel()
            await asyncio.wait((reading,))
        if not patient:
            await _flush(writer)
    finally:
        await transport.close()
        end(writer.transport)


def end(pipe: asyncio.WriteTransport) -> None:
    """Close at once, what is not written is lost; asyncio's pipes cannot bear to be told twice."""
    if not pipe.is_closing():
        pipe.abort()


class _Mouth:
    """Writes what the transport brings to the stream."""

    def __init__(self, writer: asyncio.StreamWriter, *, patient: bool) -> None:
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._writer = writer
        self._patient = patient

    def data(self, chunk: bytes) -> None:
        # The answers to one chunk may exceed the limit by any amount: a host that asks a lot at once does nothing
        # wrong.
        if self._writer.transport.get_write_buffer_size() <= MOST_WAITING:
            self._writer.write(chunk)
        elif not self._patient:
            self._writer.transport.abort()
            self.lost(None)

    def lost(self, error: Exception | None) -> None:
        if not self.ended.done():
            self.ended.set_result(None)


async def _read(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, transport: Transport, *, patient: bool
) -> None:
    try:
        while chunk := await reader.read(_CHUNK):
            await transport.send(chunk)
            await asyncio.sleep(0)  # lets the answers out, which drain() is to wait for
            if not patient:
                await writer.drain()
    except (TransportError, OSError):
        return  # either end is gone, which is how every conversation ends


async def _flush(writer: asyncio.StreamWriter) -> None:
    writer.close()
    try:
        async with asyncio.timeout(_LINGER):
            await writer.wait_closed()
    except OSError:  # TimeoutError is one
        return
    finally:
        writer.transport.abort()
