"""First contact with a board that is being learnt: byte order, and the transmission mode in which it was."""

from __future__ import annotations

from dataclasses import dataclass

from servolink.connection.opening import FENCES
from servolink.connection.probe import BYTE_ORDERS
from servolink.doctor.learn_line import Line, Quality, SharedTransport
from servolink.doctor.learn_profile import Measured
from servolink.errors import OpenError
from servolink.profiles.profile import Confidence
from servolink.protocol.codec import Codec
from servolink.protocol.frame import ByteOrder
from servolink.protocol.packet import Query, Response
from servolink.protocol.servos import QueryServoListRequest
from servolink.protocol.settings import SendDummyDataRequest, TransmissionModeSettingRequest

SHORT_QUERIES: tuple[Query[Response], ...] = (*FENCES, QueryServoListRequest())
"""Queries with short requests and responses, in the order in which they are tried."""

_FILLER = SendDummyDataRequest(bytes(256))
"""Ends a frame that the wrong byte order made to seem 256 bytes longer, and is ignored in the right one."""


@dataclass(frozen=True, slots=True)
class Contact:
    """How a board was reached."""

    byte_order: ByteOrder
    query: Query[Response]
    """A short query that it answers."""
    mode: int
    """The transmission mode in which it was found; it is in mode 1 now. One that sent anything was in mode 1."""
    silent_queries: int
    """Queries in its byte order that it did not answer before mode 1 was set."""


async def make_contact(transport: SharedTransport, patience: float | None = None) -> Contact:
    """Query in both byte orders, then set mode 1 and query again. Raise OpenError if nothing is answered.

    It may take several seconds; `patience` is the time to wait for each response.
    """
    received = silent = 0
    for mode in (1, 0):
        for query in SHORT_QUERIES:
            for byte_order in BYTE_ORDERS:
                async with Line(transport, Codec(byte_order)) as line:
                    line.patience = patience or line.patience
                    if mode == 0:
                        await line.send(TransmissionModeSettingRequest(1))
                    if await line.ask(query) is not None:
                        return Contact(byte_order, query, 1 if received else mode, silent)
                    received += line.received
                    if mode == 0:
                        await line.send(_FILLER)
            silent += mode
    raise OpenError(
        f"{transport.url} does not answer in either byte order or transmission mode: is it switched on, and are port "
        "and baud rate right? `servolink doctor` without --learn finds out"
    )


def byte_order_finding(contact: Contact, quality: Quality) -> Measured:
    """Return the byte order: a response in the wrong one would not be a frame at all."""
    answered = len(quality.round_trips)
    text = f"{answered} of {quality.asked} queries in {contact.byte_order} byte order had a response that can be read"
    return Measured("byte_order", contact.byte_order, "certain" if answered > 1 else "likely", text)


def mode_findings(contact: Contact, quality: Quality, *, power_cycled: bool) -> list[Measured]:
    """Return the mode at power-up, if the board was just switched on, and when mode 1 is to be set."""
    if contact.mode == 1:
        seen = "answered without mode 1 being set"
    else:
        seen = f"left {contact.silent_queries} queries unanswered, and answered as soon as mode 1 was set"
    if not power_cycled:
        text = f"it {seen}; switch it off and on first (--power-cycled) to learn its mode at power-up"
        settings = [Measured("power_up_mode", None, "guess", text)]
        if contact.mode == 0:
            settings.append(Measured("transmission_mode", 1, "likely" if quality.is_clean else "guess", f"it {seen}"))
        return settings
    confidence: Confidence = "guess"
    if contact.mode == 1 or quality.is_clean:
        confidence = "certain"
    elif quality.loss**contact.silent_queries < 1e-4:
        confidence = "likely"
    text = f"just switched on, it {seen}"
    return [
        Measured("power_up_mode", contact.mode, confidence, text),
        Measured("transmission_mode", 1 if contact.mode == 0 else "auto", confidence, text),
    ]
