"""First contact: a connection to a board in either byte order and transmission mode, by the opening of all programs."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from servolink.connection import Connection, ConnectionOptions, HandshakeFailed
from servolink.doctor.learn_line import SharedTransport
from servolink.errors import ConnectionLost, DecodeError, RequestTimeout, TransportError
from servolink.protocol import ByteOrder, QueryProjectIDRequest
from servolink.transports import create

PATIENCE = 1.0
"""Seconds of silence after which a device counts as no board, with `probe`."""

_FIRST, _SECOND = 2.4, 1.1  # the same in the expected byte order and in the other one
_FILLER = bytes(265)  # ends a frame that seems 256 bytes longer in the wrong byte order
AFTER_RESET = 0.3
"""Seconds from a reset by the first opening to the second one."""
_PATIENCES_AFTER_OPENING = 3


@dataclass(frozen=True, slots=True)
class ProbeResponse:
    """How a board responded."""

    byte_order: ByteOrder
    transmission_mode: int
    """Apparent mode before the contact, which sets mode 1: 1 for the document's protocol, 0 for the old protocol."""
    project_id: int | None
    """None for a board without an answer to the query."""
    seconds: float


@dataclass(frozen=True, slots=True)
class ProbeResult:
    """The result of probing a device."""

    response: ProbeResponse | None
    problem: str = ""
    """Cause of a failed opening; empty for an open device, whether or not a board answers."""


async def connect_in_any_order(
    transport: SharedTransport,
    byte_order: ByteOrder = "little",
    *,
    patience: float | None = None,
    unsupported: Collection[str] = (),
    ignore_extra: bool = False,
) -> Connection:
    """Return a connection in `byte_order`, or else in the other one; the board may answer twice.

    Raise HandshakeFailed, with the evidence that says the most, if no board answers, and TransportError if the
    transport cannot be opened or is lost.
    """
    orders: tuple[ByteOrder, ...] = (byte_order, "little" if byte_order == "big" else "big")
    failures: list[HandshakeFailed] = []
    for order, seconds in zip(orders, (patience or _FIRST, min(patience or _SECOND, _SECOND)), strict=True):
        connection = Connection(
            transport,
            ConnectionOptions(byte_order=order, patience=seconds, answers_twice=True, ignore_extra=ignore_extra),
            unsupported=unsupported,
        )
        try:
            await connection.open()
            await connection.shake_hands()
        except HandshakeFailed as error:
            await connection.close()
            if error.evidence.answered or error.evidence.longer or error.evidence.several:
                raise
            failures.append(error)
            await transport.send(_FILLER)
        except BaseException:
            await connection.close()
            raise
        else:
            return connection
    raise max(failures, key=lambda error: error.evidence.is_board)


async def reach(url: str, byte_order: ByteOrder = "little", **options: Any) -> tuple[SharedTransport, Connection]:
    """Open the device at `url`, a second time if the first opening resets the board, and make contact."""
    for is_last in (False, True):
        transport = SharedTransport(create(url))
        try:
            return transport, await connect_in_any_order(transport, byte_order, **options)
        except ConnectionLost:
            await transport.free()
            if is_last:
                raise
            await asyncio.sleep(AFTER_RESET)
        except BaseException:
            await transport.free()
            raise
    raise AssertionError  # the last round returns or raises


async def response_of(connection: Connection) -> ProbeResponse:
    """Return how the board of a contact responds."""
    loop = asyncio.get_running_loop()
    # First a query that the board answers: a slow board may still owe responses to the opening.
    await connection.request(connection.answered[0], timeout=_PATIENCES_AFTER_OPENING * connection.patience)
    begun = loop.time()
    project_id = None
    if "QueryProjectID" not in connection.unsupported:
        with suppress(RequestTimeout, DecodeError):
            project_id = (await connection.request(QueryProjectIDRequest())).project_id
    if project_id is None:
        begun = loop.time()
        await connection.request(connection.answered[0])
    mode = 0 if connection.opener.woke else 1
    return ProbeResponse(connection.codec.byte_order, mode, project_id, loop.time() - begun)


async def probe(url: str, patience: float | None = None) -> ProbeResult:
    """Ask the device at `url` whether it is a board, for `patience` seconds of silence (1 unless given), and close it.

    A board that is silent is put into the new transmission mode. It is left there: one that was only slow to start must
    not be put into the old mode.
    """
    try:
        transport, connection = await reach(url, patience=patience or PATIENCE)
    except HandshakeFailed:
        return ProbeResult(None)
    except TransportError as error:
        return ProbeResult(None, str(error))
    try:
        return ProbeResult(await response_of(connection))
    except (TransportError, RequestTimeout) as error:
        return ProbeResult(None, str(error))
    finally:
        await connection.close()
        await transport.free()
