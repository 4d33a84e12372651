"""Settings (document, 3.1): transmission mode, stored data, memory, battery, test data."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from servolink.protocol.packet import (
    U8,
    Command,
    Data,
    Effect,
    Flag,
    Natural16,
    Natural32,
    Query,
    Request,
    Response,
    Result,
)


class TransmissionModeSettingResponse(Response, frozen=True, gc=False):
    """The transmission mode now in force."""

    packet_id: ClassVar[int] = 10011
    section: ClassVar[str] = "3.1.1.2"
    result: Annotated[U8, Meta(description="0 old protocol, 1 new protocol (an echo, not success)")]


class TransmissionModeSettingRequest(Request[TransmissionModeSettingResponse], frozen=True, gc=False):
    """Set the transmission mode; mode 0 switches the board to the old protocol."""

    packet_id: ClassVar[int] = 10010
    section: ClassVar[str] = "3.1.1.1"
    effect: ClassVar[Effect] = Effect.NONE
    repeatable: ClassVar[bool] = True
    exclusive: ClassVar[bool] = True
    mode: Annotated[Flag, Meta(description="0 old protocol, 1 new protocol")]


class ClearAllDataResponse(Result, frozen=True, gc=False):
    """Whether the stored data was deleted."""

    packet_id: ClassVar[int] = 10021
    section: ClassVar[str] = "3.1.2.2"


class ClearAllDataRequest(Request[ClearAllDataResponse], frozen=True, gc=False):
    """Delete all data stored on the board."""

    packet_id: ClassVar[int] = 10020
    section: ClassVar[str] = "3.1.2.1"
    effect: ClassVar[Effect] = Effect.NONE
    exclusive: ClassVar[bool] = True


class QueryMemorySizeResponse(Response, frozen=True, gc=False):
    """Free and total memory of the board."""

    packet_id: ClassVar[int] = 10031
    section: ClassVar[str] = "3.1.3.2"
    size: Annotated[Natural32, Meta(description="free memory; the document names no unit")]
    total_size: Annotated[
        Natural32 | None, Meta(description="total memory in the same unit; none from boards that send 4 bytes")
    ] = None


class QueryMemorySizeRequest(Query[QueryMemorySizeResponse], frozen=True, gc=False):
    """Ask for free and total memory."""

    packet_id: ClassVar[int] = 10030
    section: ClassVar[str] = "3.1.3.1"


class QueryRemainPowerResponse(Response, frozen=True, gc=False):
    """Remaining charge of the battery."""

    packet_id: ClassVar[int] = 10041
    section: ClassVar[str] = "3.1.4.2"
    permil: Annotated[Natural16, Meta(description="remaining charge, per mille")]


class QueryRemainPowerRequest(Query[QueryRemainPowerResponse], frozen=True, gc=False):
    """Ask for the remaining charge of the battery."""

    packet_id: ClassVar[int] = 10040
    section: ClassVar[str] = "3.1.4.1"


class SendDummyDataRequest(Command, frozen=True, gc=False):
    """Test data, discarded by the board; no response."""

    packet_id: ClassVar[int] = 10050
    section: ClassVar[str] = "3.1.5.1"
    effect: ClassVar[Effect] = Effect.NONE
    data: Annotated[Data, Meta(description="any bytes")] = b""
