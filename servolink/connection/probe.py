"""Test whether a device is a board, in both byte orders and both transmission modes."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from servolink.errors import ConnectionLost, TransportError
from servolink.escaping import escape
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryProjectIDRequest, QueryProjectIDResponse
from servolink.protocol.frame import ByteOrder, Frame
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import TransmissionModeSettingRequest
from servolink.transports.base import Transport
from servolink.transports.registry import create

BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
PATIENCE = 0.4
"""Seconds to wait for each response, unless given."""

_LISTENING = 0.1  # seconds before the first question
_ROUNDS = 3  # a single question may be lost on a bad line
_OLD, _NEW = 0, 1
_UNASKED_FOR = bytes(265)  # ends a frame whose length is too great by 256 bytes in the wrong byte order


@dataclass(frozen=True, slots=True)
class ProbeResponse:
    """Outcome of a probe: how a board responded."""

    byte_order: ByteOrder
    transmission_mode: int
    """Apparent mode before the probe, which sets mode 1: 1 for the document's protocol, 0 for the old protocol."""
    project_id: int
    seconds: float


@dataclass(frozen=True, slots=True)
class ProbeResult:
    """The result of probing a device."""

    response: ProbeResponse | None
    unasked_bytes: int
    """Bytes received before the first query."""
    received_bytes: int
    problem: str = ""
    """Cause of a failed query; empty after a successful one."""


async def probe(url: str, patience: float = PATIENCE) -> ProbeResult:
    """Query the device at `url`, with up to `patience` seconds for each response, and close the device.

    A board that does not answer is put into the new transmission mode and asked again. It is left there: one that
    was only slow to start must not be put into the old mode.
    """
    try:
        transport = create(url)
        ear = _Ear()
        await transport.open(ear)
    except TransportError as error:
        return ProbeResult(None, 0, 0, str(error))
    try:
        await asyncio.sleep(_LISTENING)
        unasked = ear.received
        return ProbeResult(await _ask(transport, ear, unasked, patience), unasked, ear.received)
    except TransportError as error:
        return ProbeResult(None, 0, ear.received, str(error))
    finally:
        await transport.close()


async def _ask(transport: Transport, ear: _Ear, unasked: int, patience: float) -> ProbeResponse | None:
    for byte_order in BYTE_ORDERS * _ROUNDS:
        if answer := await _project_id(transport, ear, byte_order, _NEW, patience):
            return answer
    mode = _OLD if ear.received == unasked else _NEW  # a board with a damaged response is in the new mode
    for byte_order in BYTE_ORDERS:
        await transport.send(Codec(byte_order).encode(TransmissionModeSettingRequest(_NEW)))
        if answer := await _project_id(transport, ear, byte_order, mode, patience):
            return answer
        await transport.send(_UNASKED_FOR)
    return None


async def _project_id(
    transport: Transport, ear: _Ear, byte_order: ByteOrder, mode: int, patience: float
) -> ProbeResponse | None:
    loop = asyncio.get_running_loop()
    codec = Codec(byte_order)
    begun = loop.time()
    answer = ear.listen_for(codec, QueryProjectIDResponse.packet_id)
    await transport.send(codec.encode(QueryProjectIDRequest()))
    await asyncio.wait((answer,), timeout=patience)
    if not answer.done():
        return None
    response = answer.result()
    if not isinstance(response, QueryProjectIDResponse):
        return None
    return ProbeResponse(byte_order, mode, response.project_id, loop.time() - begun)


@dataclass(slots=True)
class _Ear:
    """Receives frames in both byte orders; in the wrong order no id fits."""

    received: int = 0
    _parsers: list[FrameParser] = field(default_factory=lambda: [FrameParser(order) for order in BYTE_ORDERS])
    _expected: tuple[Codec, int, asyncio.Future[Packet]] | None = None

    def listen_for(self, codec: Codec, packet_id: int) -> asyncio.Future[Packet]:
        """Return a future for the next packet with the id in the byte order of `codec`."""
        answer = asyncio.get_running_loop().create_future()
        self._expected = codec, packet_id, answer
        return answer

    def data(self, chunk: bytes, /) -> None:
        self.received += len(chunk)
        for parser in self._parsers:
            for frame in parser.feed(chunk):
                self._take(parser.byte_order, frame)

    def lost(self, error: Exception | None, /) -> None:
        if self._expected is not None and not self._expected[2].done():
            answer = self._expected[2]
            answer.set_exception(ConnectionLost(f"it was lost while being asked: {escape(str(error))}"))
            answer.exception()  # retrieved, as perhaps no task waits any more

    def _take(self, byte_order: ByteOrder, frame: Frame) -> None:
        packet_id, content = frame
        if self._expected is not None:
            codec, expected_id, answer = self._expected
            if (codec.byte_order, expected_id) == (byte_order, packet_id) and not answer.done():
                answer.set_result(codec.decode(packet_id, content))
