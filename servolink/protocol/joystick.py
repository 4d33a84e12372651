"""Remote control (document, 3.4): joystick tables, button events."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from servolink.protocol.packet import I32, U8, U16_COUNT, U32, Effect, Flag, Query, Request, Response, Result
from servolink.protocol.records import JoystickTable, JoystickTableEntry


class QueryJoystickTableListResponse(Response, frozen=True, gc=False):
    """All joystick tables stored on the board."""

    packet_id: ClassVar[int] = 40011
    section: ClassVar[str] = "3.4.1.2"
    tables: Annotated[tuple[JoystickTableEntry, ...], U16_COUNT] = ()


class QueryJoystickTableListRequest(Query[QueryJoystickTableListResponse], frozen=True, gc=False):
    """Ask for the list of joystick tables."""

    packet_id: ClassVar[int] = 40010
    section: ClassVar[str] = "3.4.1.1"


class QueryJoystickTableResponse(JoystickTable, Response, frozen=True, gc=False):
    """The requested joystick table; id 0 and a meaningless caption for a missing table."""

    packet_id: ClassVar[int] = 40021
    section: ClassVar[str] = "3.4.2.2"


class QueryJoystickTableRequest(Query[QueryJoystickTableResponse], frozen=True, gc=False):
    """Ask for a single joystick table."""

    packet_id: ClassVar[int] = 40020
    section: ClassVar[str] = "3.4.2.1"
    echoed: ClassVar[str] = "table_id"
    table_id: I32


class AddJoystickTableResponse(Result, frozen=True, gc=False):
    """Whether the table was added."""

    packet_id: ClassVar[int] = 40031
    section: ClassVar[str] = "3.4.3.2"


class AddJoystickTableRequest(JoystickTable, Request[AddJoystickTableResponse], frozen=True, gc=False):
    """Add a joystick table."""

    packet_id: ClassVar[int] = 40030
    section: ClassVar[str] = "3.4.3.1"
    effect: ClassVar[Effect] = Effect.NONE
    changes: ClassVar[str] = "table_id"


class DeleteJoystickTableResponse(Result, frozen=True, gc=False):
    """Whether the table was deleted."""

    packet_id: ClassVar[int] = 40041
    section: ClassVar[str] = "3.4.4.2"


class DeleteJoystickTableRequest(Request[DeleteJoystickTableResponse], frozen=True, gc=False):
    """Delete a single joystick table."""

    packet_id: ClassVar[int] = 40040
    section: ClassVar[str] = "3.4.4.1"
    effect: ClassVar[Effect] = Effect.NONE
    changes: ClassVar[str] = "table_id"
    table_id: I32


class SetActiveJoystickTableResponse(Result, frozen=True, gc=False):
    """Whether the table is active now."""

    packet_id: ClassVar[int] = 40051
    section: ClassVar[str] = "3.4.5.2"


class SetActiveJoystickTableRequest(Request[SetActiveJoystickTableResponse], frozen=True, gc=False):
    """Make a joystick table active."""

    packet_id: ClassVar[int] = 40050
    section: ClassVar[str] = "3.4.5.1"
    effect: ClassVar[Effect] = Effect.MAY_MOVE
    repeatable: ClassVar[bool] = True
    table_id: I32


class QueryActiveJoystickTableResponse(Response, frozen=True, gc=False):
    """The id of the active joystick table; 0 if the board has no table."""

    packet_id: ClassVar[int] = 40061
    section: ClassVar[str] = "3.4.6.2"
    table_id: I32


class QueryActiveJoystickTableRequest(Query[QueryActiveJoystickTableResponse], frozen=True, gc=False):
    """Ask for the id of the active joystick table."""

    packet_id: ClassVar[int] = 40060
    section: ClassVar[str] = "3.4.6.1"


class SubscribeButtonEventResponse(Result, frozen=True, gc=False):
    """Whether the subscription was changed."""

    packet_id: ClassVar[int] = 40071
    section: ClassVar[str] = "3.4.7.2"


class SubscribeButtonEventRequest(Request[SubscribeButtonEventResponse], frozen=True, gc=False):
    """Start or end button events."""

    packet_id: ClassVar[int] = 40070
    section: ClassVar[str] = "3.4.7.1"
    effect: ClassVar[Effect] = Effect.NONE
    repeatable: ClassVar[bool] = True
    subscribe: Annotated[Flag, Meta(description="0 end, 1 start")]


class ButtonEventResponse(Response, frozen=True, gc=False):
    """Button event, sent by the board without a request after a subscription."""

    packet_id: ClassVar[int] = 40081
    section: ClassVar[str] = "3.4.8.2"
    PRESS: ClassVar[int] = 1
    LONG_PRESS: ClassVar[int] = 2
    UP: ClassVar[int] = 4
    button_id: U32
    event: Annotated[U8, Meta(description="1 press, 2 long press, 4 up")]

    @property
    def kind(self) -> str:
        """Event in words: `press`, `long_press`, `up`, or `event N` for a number undefined in the document."""
        return {self.PRESS: "press", self.LONG_PRESS: "long_press", self.UP: "up"}.get(
            self.event, f"event {self.event}"
        )

    def __repr__(self) -> str:
        """Return the event under the public name of the class, `servolink.ButtonEvent`."""
        return f"ButtonEvent(button_id={self.button_id}, event={self.event})"
