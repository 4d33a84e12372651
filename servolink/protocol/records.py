"""The records stored on a board, and their parts."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Annotated, Any

from msgspec import Meta, Struct

from servolink.errors import EncodeError
from servolink.escaping import quote
from servolink.protocol.packet import (
    I16,
    I32,
    U8,
    U16_COUNT,
    U32,
    Caption,
    CommandType,
    Flag,
    Natural16,
    Natural32,
    Percent,
)


class RecordRef(int):
    """The id of `record`, and the record itself: a macro can be written before what it calls has an id."""

    record: Any

    @classmethod
    def of(cls, record: Any) -> RecordRef:
        """Return the reference to an Action or a Macro; it is 0 as long as that has no id."""
        called = cls(getattr(record, record.__struct_fields__[0]))
        called.record = record
        return called


class MacroCommandType(IntEnum):
    """The types of macro commands; a board may hold others, which the document does not name."""

    ACTION = 0
    DELAY = 1
    MACRO = 2


class Step(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """One servo's part of a movement: where it goes and how long it takes."""

    servo_id: U8
    degree: Annotated[I16, Meta(description="target, degrees or raw ADC, as set for this servo")]
    interval: Annotated[Natural16, Meta(description="time, in units of 10 ms")]

    @property
    def seconds(self) -> float:
        """The time the movement takes, to 0.01 s."""
        return self.interval / 100


class ActionEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """An action in the list of actions."""

    action_id: I32
    action_caption: Caption


class Action(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A stored pose: all steps start together, the action lasts as long as its longest step."""

    action_id: Annotated[I32, Meta(description="0 in an answer: no such action")]
    action_caption: Caption = ""
    steps: Annotated[tuple[Step, ...], U16_COUNT] = ()

    @property
    def seconds(self) -> float:
        """The time of the longest step; 0 without steps."""
        return max((step.interval for step in self.steps), default=0) / 100

    @staticmethod
    def pose(caption: str, degrees: Mapping[int, int], *, seconds: float = 1.0, action_id: int = 0) -> Action:
        """Return the action that brings servos to angles, all in `seconds` (0 to 327.67, to 0.01 s).

        Without an id it gets one in a `build_project`. EncodeError for a time that is not possible.
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
    type: Annotated[CommandType, Meta(description="0 action, 1 delay, 2 macro")] = MacroCommandType.ACTION.value
    ratio: Annotated[Percent, Meta(description="speed in percent; at 50 it takes twice as long")] = 100
    loop: Annotated[Natural16, Meta(description="how many times")] = 1
    total_interval: Annotated[Natural32, Meta(description="time of the whole command with its loops, ms")] = 0

    @staticmethod
    def of(part: Action | Macro | float, *, ratio: int = 100, loop: int = 1) -> MacroCommand:
        """Return the command that runs an action or a macro, or waits for so many seconds (to 0.001 s).

        Its `total_interval` is filled in by `build_project`. EncodeError for a pause that is not possible.
        """
        if isinstance(part, Action):
            return MacroCommand(RecordRef.of(part), MacroCommandType.ACTION.value, ratio, loop)
        if isinstance(part, Macro):
            return MacroCommand(RecordRef.of(part), MacroCommandType.MACRO.value, ratio, loop)
        return MacroCommand(_whole(part, 1000, 0x7FFF_FFFF), MacroCommandType.DELAY.value, ratio, loop)


class Macro(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A stored sequence of commands, run one after the other."""

    macro_id: Annotated[I32, Meta(description="0 in an answer: no such macro")]
    macro_caption: Caption = ""
    commands: Annotated[tuple[MacroCommand, ...], U16_COUNT] = ()

    @staticmethod
    def of(caption: str, *parts: Action | Macro | MacroCommand | float, loop: int = 1, macro_id: int = 0) -> Macro:
        """Return the macro that does `parts` one after the other, a number being a pause in seconds, `loop` times.

        Without an id it gets one in a `build_project`. EncodeError for a pause that is not possible.
        """
        commands = tuple(part if isinstance(part, MacroCommand) else MacroCommand.of(part) for part in parts)
        return Macro(macro_id, caption, commands * loop)


class ServoParameter(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """The name and the angle correction stored for one servo."""

    servo_id: U8
    adjusted_degree: Annotated[I16, Meta(description="angle correction, degrees")] = 0
    servo_caption: Caption = ""


def _whole(seconds: float, units: int, most: int) -> int:
    """Return a time in units of which a second has so many."""
    if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not 0 <= seconds * units <= most:
        raise EncodeError(f"a time must be 0..{most / units:g} s, not {quote(seconds)}")
    return round(seconds * units)


_NO_MACRO = Meta(description="macro id; 0 for none")


class JoystickTableEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A table in the list of joystick tables."""

    table_id: I32
    table_caption: Caption


class Button(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """What one button starts."""

    button_id: U32
    button_caption: Caption = ""
    button_press_macro: Annotated[I32, _NO_MACRO] = 0
    button_long_press_macro: Annotated[I32, _NO_MACRO] = 0
    button_up_macro: Annotated[I32, _NO_MACRO] = 0
    uninterruptible: Annotated[
        Flag, Meta(description="1: the long-press macro runs to its end before the button-up macro")
    ] = 0

    @staticmethod
    def of(
        button_id: int,
        caption: str = "",
        *,
        press: Macro | None = None,
        long_press: Macro | None = None,
        up: Macro | None = None,
        uninterruptible: bool = False,
    ) -> Button:
        """Return the button that starts these macros; EncodeError for what is no macro."""
        return Button(
            button_id,
            caption,
            _started(press, "press"),
            _started(long_press, "long_press"),
            _started(up, "up"),
            int(uninterruptible),
        )


class JoystickTable(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """A stored assignment of macros to buttons."""

    table_id: Annotated[I32, Meta(description="0 in an answer: no such table")]
    table_caption: Caption = ""
    buttons: Annotated[tuple[Button, ...], U16_COUNT] = ()

    @staticmethod
    def of(caption: str, *buttons: Button, table_id: int = 0) -> JoystickTable:
        """Return the table of `buttons`; without an id it gets one in a `build_project`."""
        return JoystickTable(table_id, caption, buttons)


def _started(macro: object, name: str) -> int:
    if macro is None:
        return 0
    if not isinstance(macro, Macro):
        raise EncodeError(f"must be a Macro, such as Macro.of(caption, ...) makes, not {quote(macro)}", name)
    return RecordRef.of(macro)
