"""Servos (document, 3.2): list, state, start and hold, angle unit, motion."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta, Struct

from servolink.protocol.packet import I16, I32, U8, U8_COUNT, Command, Effect, Flag, Query, Request, Response
from servolink.protocol.records import Step

ALL_SERVOS = 0xFF
"""Servo id for all servos, where a request allows it."""


class ServoState(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """State of a servo as reported by the board."""

    servo_id: U8
    angle: Annotated[I16, Meta(description="degrees or raw ADC, as set for this servo")]
    current: Annotated[I16, Meta(description="raw ADC")]
    temperature: Annotated[I16, Meta(description="raw ADC")]
    servo_type: Annotated[I16, Meta(description="kind of servo, numbered by the board")]
    is_start: Annotated[U8, Meta(description="0 stopped, 1 may move")]
    is_hold: Annotated[U8, Meta(description="0 released, 1 held")]


class QueryServoListResponse(Response, frozen=True, gc=False):
    """The ids of all servos."""

    packet_id: ClassVar[int] = 20011
    section: ClassVar[str] = "3.2.1.2"
    servo_id_list: Annotated[tuple[U8, ...], U8_COUNT] = ()


class QueryServoListRequest(Query[QueryServoListResponse], frozen=True, gc=False):
    """Ask for the ids of all servos."""

    packet_id: ClassVar[int] = 20010
    section: ClassVar[str] = "3.2.1.1"


class QueryServoResponse(Response, frozen=True, gc=False):
    """State of the requested servos; empty if no servo has the id."""

    packet_id: ClassVar[int] = 20021
    section: ClassVar[str] = "3.2.2.2"
    servos: Annotated[tuple[ServoState, ...], U8_COUNT] = ()


class QueryServoRequest(Query[QueryServoResponse], frozen=True, gc=False):
    """Ask for the state of a servo or of all."""

    packet_id: ClassVar[int] = 20020
    section: ClassVar[str] = "3.2.2.1"
    servo_id: Annotated[U8, Meta(description="255 for all")]

    def accepts(self, response: Response) -> bool:
        """Return whether the response lists all servos for "all", else at most the requested servo."""
        if self.servo_id == ALL_SERVOS or not isinstance(response, QueryServoResponse):
            return True
        return [servo.servo_id for servo in response.servos] in ([], [self.servo_id])


class SetServoParameterResponse(Response, frozen=True, gc=False):
    """The start and hold flags now in force (an echo, not success)."""

    packet_id: ClassVar[int] = 20031
    section: ClassVar[str] = "3.2.3.2"
    servo_id: Annotated[U8, Meta(description="255 for all")]
    is_start: Annotated[U8, Meta(description="0 stopped, 1 may move")]
    is_hold: Annotated[U8, Meta(description="0 released, 1 held")]


class SetServoParameterRequest(Request[SetServoParameterResponse], frozen=True, gc=False):
    """Stop or start, hold or release a servo or all."""

    packet_id: ClassVar[int] = 20030
    section: ClassVar[str] = "3.2.3.1"
    echoed: ClassVar[str] = "servo_id"
    exclusive: ClassVar[bool] = True
    servo_id: Annotated[U8, Meta(description="255 for all")]
    is_start: Annotated[Flag, Meta(description="0 stop, 1 may move")]
    is_hold: Annotated[Flag, Meta(description="0 release, 1 hold")]

    @property
    def effect(self) -> Effect:  # type: ignore[override]  # per packet, not per class as elsewhere
        """Started servos may turn to an old target; servos neither started nor held go limp."""
        if self.is_start:
            return Effect.MOVES
        return Effect.STOPS if self.is_hold == 1 else Effect.GOES_LIMP


class SetAngleUnitResponse(Response, frozen=True, gc=False):
    """The angle unit now in force (an echo, not success)."""

    packet_id: ClassVar[int] = 20041
    section: ClassVar[str] = "3.2.4.2"
    servo_id: Annotated[U8, Meta(description="255 for all")]
    unit_type: Annotated[U8, Meta(description="0 degrees, 1 raw ADC")]


class SetAngleUnitRequest(Request[SetAngleUnitResponse], frozen=True, gc=False):
    """Set the angle unit of a servo or of all, for commands and for reports."""

    packet_id: ClassVar[int] = 20040
    section: ClassVar[str] = "3.2.4.1"
    effect: ClassVar[Effect] = Effect.NONE
    echoed: ClassVar[str] = "servo_id"
    repeatable: ClassVar[bool] = True
    exclusive: ClassVar[bool] = True
    servo_id: Annotated[U8, Meta(description="255 for all")]
    unit_type: Annotated[Flag, Meta(description="0 degrees, 1 raw ADC")]


class ExecuteActionRequest(Command, frozen=True, gc=False):
    """Move servos, all at the same time; no response."""

    packet_id: ClassVar[int] = 20050
    section: ClassVar[str] = "3.2.5.1"
    effect: ClassVar[Effect] = Effect.MOVES
    steps: Annotated[tuple[Step, ...], U8_COUNT] = ()


class ExecuteActionExRequest(Command, frozen=True, gc=False):
    """Run an action stored on the board; no response."""

    packet_id: ClassVar[int] = 20060
    section: ClassVar[str] = "3.2.6.1"
    effect: ClassVar[Effect] = Effect.MOVES
    action_id: I32
