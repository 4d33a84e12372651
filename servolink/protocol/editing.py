"""Editing what is stored (document, 3.3): actions, macros, servo parameters, project id."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar

from msgspec import Meta, Struct

from servolink.errors import EncodeError
from servolink.printable import shown
from servolink.protocol.called import Called
from servolink.protocol.fields import I16, I32, U8, U16_COUNT, Caption, CommandType, Natural16, Natural32, Percent
from servolink.protocol.packet import Query, Request, Response, Result
from servolink.protocol.servos import Step


class ActionEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """An action in the list of actions."""

    action_id: I32
    action_caption: Caption


class Action(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A stored pose: all steps start together, the action lasts as long as its longest step."""

    action_id: Annotated[I32, Meta(description="0 in an answer: no such action")]
    action_caption: Caption = ""
    steps: Annotated[tuple[Step, ...], U16_COUNT] = ()

    @staticmethod
    def pose(caption: str, degrees: Mapping[int, int], *, seconds: float = 1.0, action_id: int = 0) -> Action:
        """Return the action that brings servos to angles, all in `seconds` (0 to 327.67, to 0.01 s).

        Without an id it gets one in a `Project.of`. EncodeError for a time that is not possible.
        """
        interval = _whole(seconds, 100, 0x7FFF)
        return Action(action_id, caption, tuple(Step(servo_id, angle, interval) for servo_id, angle in degrees.items()))


class MacroEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A macro in the list of macros."""

    macro_id: I32
    macro_caption: Caption


class MacroCommand(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """One command of a macro: run an action, wait, or run another macro."""

    command_id: Annotated[I32, Meta(description="action id, delay in ms, or macro id, as `type` says")]
    type: Annotated[CommandType, Meta(description="0 action, 1 delay, 2 macro")] = 0
    ratio: Annotated[Percent, Meta(description="speed in percent; at 50 it takes twice as long")] = 100
    loop: Annotated[Natural16, Meta(description="how many times")] = 1
    total_interval: Annotated[Natural32, Meta(description="time of the whole command with its loops, ms")] = 0

    @staticmethod
    def of(part: Action | Macro | float, *, ratio: int = 100, loop: int = 1) -> MacroCommand:
        """Return the command that runs an action or a macro, or waits for so many seconds (to 0.001 s).

        Its `total_interval` is filled in by `Project.of`. EncodeError for a pause that is not possible.
        """
        if isinstance(part, Action):
            return MacroCommand(Called.of(part), 0, ratio, loop)
        if isinstance(part, Macro):
            return MacroCommand(Called.of(part), 2, ratio, loop)
        return MacroCommand(_whole(part, 1000, 0x7FFF_FFFF), 1, ratio, loop)


class Macro(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A stored sequence of commands, run one after the other."""

    macro_id: Annotated[I32, Meta(description="0 in an answer: no such macro")]
    macro_caption: Caption = ""
    commands: Annotated[tuple[MacroCommand, ...], U16_COUNT] = ()

    @staticmethod
    def of(caption: str, *parts: Action | Macro | MacroCommand | float, loop: int = 1, macro_id: int = 0) -> Macro:
        """Return the macro that does `parts` one after the other, a number being a pause in seconds, `loop` times.

        Without an id it gets one in a `Project.of`. EncodeError for a pause that is not possible.
        """
        commands = tuple(part if isinstance(part, MacroCommand) else MacroCommand.of(part) for part in parts)
        return Macro(macro_id, caption, commands * loop)


class ServoParameter(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """The name and the angle correction stored for one servo."""

    servo_id: U8
    adjusted_degree: Annotated[I16, Meta(description="angle correction, degrees")] = 0
    servo_caption: Caption = ""


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
    """One action; id 0 if there is none, the caption then means nothing."""

    packet_id: ClassVar[int] = 30021
    section: ClassVar[str] = "3.3.2.2"


class QueryActionRequest(Query[QueryActionResponse], frozen=True, gc=False):
    """Ask for one action."""

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


class DeleteActionResponse(Result, frozen=True, gc=False):
    """Whether the action was deleted."""

    packet_id: ClassVar[int] = 30041
    section: ClassVar[str] = "3.3.4.2"


class DeleteActionRequest(Request[DeleteActionResponse], frozen=True, gc=False):
    """Delete one action."""

    packet_id: ClassVar[int] = 30040
    section: ClassVar[str] = "3.3.4.1"
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
    """One macro; id 0 if there is none, the caption then means nothing."""

    packet_id: ClassVar[int] = 30061
    section: ClassVar[str] = "3.3.6.2"


class QueryMacroRequest(Query[QueryMacroResponse], frozen=True, gc=False):
    """Ask for one macro."""

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


class DeleteMacroResponse(Result, frozen=True, gc=False):
    """Whether the macro was deleted."""

    packet_id: ClassVar[int] = 30081
    section: ClassVar[str] = "3.3.8.2"


class DeleteMacroRequest(Request[DeleteMacroResponse], frozen=True, gc=False):
    """Delete one macro."""

    packet_id: ClassVar[int] = 30080
    section: ClassVar[str] = "3.3.8.1"
    macro_id: I32


class ExecuteMacroResponse(Result, frozen=True, gc=False):
    """Whether the macro was started."""

    packet_id: ClassVar[int] = 30091
    section: ClassVar[str] = "3.3.9.2"


class ExecuteMacroRequest(Request[ExecuteMacroResponse], frozen=True, gc=False):
    """Run a macro stored on the board."""

    packet_id: ClassVar[int] = 30090
    section: ClassVar[str] = "3.3.9.1"
    macro_id: I32


class QueryServoParameterResponse(Response, frozen=True, gc=False):
    """The parameters of all servos; none after an error."""

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
    servos: Annotated[tuple[ServoParameter, ...], U16_COUNT] = ()


class WriteProjectIDResponse(Result, frozen=True, gc=False):
    """Whether the project id was written."""

    packet_id: ClassVar[int] = 30121
    section: ClassVar[str] = "3.3.12.2"


class WriteProjectIDRequest(Request[WriteProjectIDResponse], frozen=True, gc=False):
    """Write the project id over the one the board has."""

    packet_id: ClassVar[int] = 30120
    section: ClassVar[str] = "3.3.12.1"
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


def _whole(seconds: float, units: int, most: int) -> int:
    """Return a time in units of which a second has so many."""
    if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not 0 <= seconds * units <= most:
        raise EncodeError(f"{shown(seconds)} is no time of 0..{most / units:g} s")
    return round(seconds * units)
