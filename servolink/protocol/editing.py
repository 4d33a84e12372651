"""Stored records (document, 3.3): actions, macros, servo parameters, project id."""

from __future__ import annotations

from typing import Annotated, ClassVar

from servolink.protocol.packet import (
    I32,
    U16_COUNT,
    Effect,
    Query,
    Request,
    Response,
    Result,
)
from servolink.protocol.records import Action, ActionEntry, Macro, MacroEntry, ServoParameter


class QueryActionListResponse(Response, frozen=True, gc=False):
    """All actions stored on the board."""

    packet_id: ClassVar[int] = 30011
    section: ClassVar[str] = "3.3.1.2"
    actions: Annotated[tuple[ActionEntry, ...], U16_COUNT] = ()


class QueryActionListRequest(Query[QueryActionListResponse], frozen=True, gc=False):
    """Ask for the list of actions."""

    packet_id: ClassVar[int] = 30010
    section: ClassVar[str] = "3.3.1.1"


class QueryActionResponse(Action, Response, frozen=True, gc=False):
    """The requested action; id 0 and a meaningless caption for a missing action."""

    packet_id: ClassVar[int] = 30021
    section: ClassVar[str] = "3.3.2.2"


class QueryActionRequest(Query[QueryActionResponse], frozen=True, gc=False):
    """Ask for a single action."""

    packet_id: ClassVar[int] = 30020
    section: ClassVar[str] = "3.3.2.1"
    echoed: ClassVar[str] = "action_id"
    action_id: I32


class AddActionResponse(Result, frozen=True, gc=False):
    """Whether the action was added."""

    packet_id: ClassVar[int] = 30031
    section: ClassVar[str] = "3.3.3.2"


class AddActionRequest(Action, Request[AddActionResponse], frozen=True, gc=False):
    """Add an action."""

    packet_id: ClassVar[int] = 30030
    section: ClassVar[str] = "3.3.3.1"
    effect: ClassVar[Effect] = Effect.NONE
    changes: ClassVar[str] = "action_id"


class DeleteActionResponse(Result, frozen=True, gc=False):
    """Whether the action was deleted."""

    packet_id: ClassVar[int] = 30041
    section: ClassVar[str] = "3.3.4.2"


class DeleteActionRequest(Request[DeleteActionResponse], frozen=True, gc=False):
    """Delete a single action."""

    packet_id: ClassVar[int] = 30040
    section: ClassVar[str] = "3.3.4.1"
    effect: ClassVar[Effect] = Effect.NONE
    changes: ClassVar[str] = "action_id"
    action_id: I32


class QueryMacroListResponse(Response, frozen=True, gc=False):
    """All macros stored on the board."""

    packet_id: ClassVar[int] = 30051
    section: ClassVar[str] = "3.3.5.2"
    macros: Annotated[tuple[MacroEntry, ...], U16_COUNT] = ()


class QueryMacroListRequest(Query[QueryMacroListResponse], frozen=True, gc=False):
    """Ask for the list of macros."""

    packet_id: ClassVar[int] = 30050
    section: ClassVar[str] = "3.3.5.1"


class QueryMacroResponse(Macro, Response, frozen=True, gc=False):
    """The requested macro; id 0 and a meaningless caption for a missing macro."""

    packet_id: ClassVar[int] = 30061
    section: ClassVar[str] = "3.3.6.2"


class QueryMacroRequest(Query[QueryMacroResponse], frozen=True, gc=False):
    """Ask for a single macro."""

    packet_id: ClassVar[int] = 30060
    section: ClassVar[str] = "3.3.6.1"
    echoed: ClassVar[str] = "macro_id"
    macro_id: I32


class AddMacroResponse(Result, frozen=True, gc=False):
    """Whether the macro was added."""

    packet_id: ClassVar[int] = 30071
    section: ClassVar[str] = "3.3.7.2"


class AddMacroRequest(Macro, Request[AddMacroResponse], frozen=True, gc=False):
    """Add a macro."""

    packet_id: ClassVar[int] = 30070
    section: ClassVar[str] = "3.3.7.1"
    effect: ClassVar[Effect] = Effect.NONE
    changes: ClassVar[str] = "macro_id"


class DeleteMacroResponse(Result, frozen=True, gc=False):
    """Whether the macro was deleted."""

    packet_id: ClassVar[int] = 30081
    section: ClassVar[str] = "3.3.8.2"


class DeleteMacroRequest(Request[DeleteMacroResponse], frozen=True, gc=False):
    """Delete a single macro."""

    packet_id: ClassVar[int] = 30080
    section: ClassVar[str] = "3.3.8.1"
    effect: ClassVar[Effect] = Effect.NONE
    changes: ClassVar[str] = "macro_id"
    macro_id: I32


class ExecuteMacroResponse(Result, frozen=True, gc=False):
    """Whether the macro was started."""

    packet_id: ClassVar[int] = 30091
    section: ClassVar[str] = "3.3.9.2"


class ExecuteMacroRequest(Request[ExecuteMacroResponse], frozen=True, gc=False):
    """Run a macro stored on the board."""

    packet_id: ClassVar[int] = 30090
    section: ClassVar[str] = "3.3.9.1"
    effect: ClassVar[Effect] = Effect.MOVES
    exclusive: ClassVar[bool] = True
    macro_id: I32


class QueryServoParameterResponse(Response, frozen=True, gc=False):
    """The parameters of all servos; empty after an error."""

    packet_id: ClassVar[int] = 30101
    section: ClassVar[str] = "3.3.10.2"
    servos: Annotated[tuple[ServoParameter, ...], U16_COUNT] = ()


class QueryServoParameterRequest(Query[QueryServoParameterResponse], frozen=True, gc=False):
    """Ask for the parameters of all servos."""

    packet_id: ClassVar[int] = 30100
    section: ClassVar[str] = "3.3.10.1"


class AddServoParameterResponse(Result, frozen=True, gc=False):
    """Whether the parameters were stored."""

    packet_id: ClassVar[int] = 30111
    section: ClassVar[str] = "3.3.11.2"


class AddServoParameterRequest(Request[AddServoParameterResponse], frozen=True, gc=False):
    """Store parameters of servos."""

    packet_id: ClassVar[int] = 30110
    section: ClassVar[str] = "3.3.11.1"
    effect: ClassVar[Effect] = Effect.MAY_MOVE
    servos: Annotated[tuple[ServoParameter, ...], U16_COUNT] = ()


class WriteProjectIDResponse(Result, frozen=True, gc=False):
    """Whether the project id was written."""

    packet_id: ClassVar[int] = 30121
    section: ClassVar[str] = "3.3.12.2"


class WriteProjectIDRequest(Request[WriteProjectIDResponse], frozen=True, gc=False):
    """Replace the board's project id."""

    packet_id: ClassVar[int] = 30120
    section: ClassVar[str] = "3.3.12.1"
    effect: ClassVar[Effect] = Effect.NONE
    repeatable: ClassVar[bool] = True
    project_id: I32


class QueryProjectIDResponse(Response, frozen=True, gc=False):
    """The project id; 0 if the board has none."""

    packet_id: ClassVar[int] = 30131
    section: ClassVar[str] = "3.3.13.2"
    project_id: I32


class QueryProjectIDRequest(Query[QueryProjectIDResponse], frozen=True, gc=False):
    """Ask for the project id."""

    packet_id: ClassVar[int] = 30130
    section: ClassVar[str] = "3.3.13.1"
