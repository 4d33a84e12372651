"""Records stored on a board (document, 3.3 and 3.4), their parts, and the playing of macros."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from enum import IntEnum
from typing import Annotated, Any, ClassVar

from msgspec import Meta, Struct

from servolink.errors import EncodeError, quote
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
from servolink.support import as_number, is_number


class RecordRef(int):
    """Record id together with the record: a macro can refer to an action without an id so far."""

    record: Any

    @classmethod
    def of(cls, record: Any) -> RecordRef:
        """Return the reference to an Action or a Macro; the value is 0 for a record without an id."""
        reference = cls(getattr(record, record.__struct_fields__[0]))
        reference.record = record
        return reference


class MacroCommandType(IntEnum):
    """Types of macro commands; a board may store other numbers, undefined in the document."""

    ACTION = 0
    DELAY = 1
    MACRO = 2


class Step(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Part of a movement for a single servo: target and duration."""

    servo_id: U8
    degree: Annotated[I16, Meta(description="target, degrees or raw ADC, as set for this servo")]
    interval: Annotated[Natural16, Meta(description="time, in units of 10 ms")]

    @property
    def seconds(self) -> float:
        """Duration in seconds, in steps of 0.01 s."""
        return self.interval / 100


class ActionEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """An entry in the list of actions."""

    action_id: I32
    action_caption: Caption


class Action(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Stored pose. All steps start together; the action lasts as long as the longest step."""

    action_id: Annotated[I32, Meta(description="0 in a response: no such action")]
    action_caption: Caption = ""
    steps: Annotated[tuple[Step, ...], U16_COUNT] = ()

    @property
    def seconds(self) -> float:
        """Duration of the longest step in seconds; 0 without steps."""
        return max((step.interval for step in self.steps), default=0) / 100

    @staticmethod
    def pose(caption: str, degrees: Mapping[int, float], *, seconds: float = 1.0, action_id: int = 0) -> Action:
        """Return an action with targets `degrees` (whole angles by servo id), each reached in `seconds` (0 to 327.67).

        For the id 0, `build_project` assigns an id. Raise EncodeError for a time out of range.
        """
        interval = _in_units(seconds, 100, 0x7FFF)
        steps = (Step(as_number(servo_id), _whole(angle), interval) for servo_id, angle in degrees.items())
        return Action(as_number(action_id), caption, tuple(steps))


class MacroEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """An entry in the list of macros."""

    macro_id: I32
    macro_caption: Caption


class MacroCommand(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Command of a macro: run an action, wait, or run another macro."""

    command_id: Annotated[I32, Meta(description="action id, delay in ms or macro id, depending on `type`")]
    type: Annotated[CommandType, Meta(description="0 action, 1 delay, 2 macro")] = MacroCommandType.ACTION.value
    ratio: Annotated[Percent, Meta(description="speed in percent; at 50 the command takes twice as long")] = 100
    loop: Annotated[Natural16, Meta(description="number of repetitions")] = 1
    total_interval: Annotated[Natural32, Meta(description="duration of the command with its loops, ms")] = 0

    @staticmethod
    def of(part: Action | Macro | float, *, ratio: int = 100, loop: int = 1) -> MacroCommand:
        """Return the command to run an action or a macro, or to wait for a number of seconds (to 0.001 s).

        `build_project` fills in `total_interval`. Raise EncodeError for any other part, or a pause out of range.
        """
        ratio, loop = as_number(ratio), as_number(loop)
        if isinstance(part, Action):
            return MacroCommand(RecordRef.of(part), MacroCommandType.ACTION.value, ratio, loop)
        if isinstance(part, Macro):
            return MacroCommand(RecordRef.of(part), MacroCommandType.MACRO.value, ratio, loop)
        if not is_number(as_number(part)):
            raise EncodeError(f"a part of a macro must be an Action, a Macro or a pause in seconds, not {quote(part)}")
        return MacroCommand(_in_units(part, 1000, 0x7FFF_FFFF), MacroCommandType.DELAY.value, ratio, loop)


class Macro(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Stored sequence of commands, run in order."""

    MAX_NESTING: ClassVar[int] = 32
    """Maximum depth of macros run by macros, the outermost included, on virtual boards and in programs that follow one.

    The document has no such limit.
    """

    macro_id: Annotated[I32, Meta(description="0 in a response: no such macro")]
    macro_caption: Caption = ""
    commands: Annotated[tuple[MacroCommand, ...], U16_COUNT] = ()

    @staticmethod
    def of(caption: str, *parts: Action | Macro | MacroCommand | float, loop: int = 1, macro_id: int = 0) -> Macro:
        """Return the macro to run `parts` in order, `loop` times; a number is a pause in seconds.

        For the id 0, `build_project` assigns an id. Raise EncodeError for any other part, or a pause out of range.
        """
        commands = tuple(part if isinstance(part, MacroCommand) else MacroCommand.of(part) for part in parts)
        return Macro(as_number(macro_id), caption, commands * as_number(loop))


class ServoParameter(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Caption and angle correction stored for a servo."""

    servo_id: U8
    adjusted_degree: Annotated[I16, Meta(description="angle correction, degrees")] = 0
    servo_caption: Caption = ""


def _whole(angle: object) -> Any:
    """Return a whole number as an int; anything else is refused when the record is encoded."""
    number = as_number(angle)
    return int(number) if isinstance(number, float) and number.is_integer() else number


def _in_units(seconds: float, per_second: int, most: int) -> int:
    """Return a time in units of `1 / per_second` seconds."""
    seconds = as_number(seconds)
    if not is_number(seconds) or not 0 <= seconds * per_second <= most:
        raise EncodeError(f"a time must be 0..{most / per_second:g} s, not {quote(seconds)}")
    return round(seconds * per_second)


_NO_MACRO = Meta(description="macro id; 0 for none")


class JoystickTableEntry(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """An entry in the list of joystick tables."""

    table_id: I32
    table_caption: Caption


class Button(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Macros started by a button."""

    button_id: U32
    button_caption: Caption = ""
    button_press_macro: Annotated[I32, _NO_MACRO] = 0
    button_long_press_macro: Annotated[I32, _NO_MACRO] = 0
    button_up_macro: Annotated[I32, _NO_MACRO] = 0
    uninterruptible: Annotated[
        Flag, Meta(description="1: the button-up macro starts only after the end of the long-press macro")
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
        """Return the button for these macros. Raise EncodeError for anything but a Macro."""
        return Button(
            as_number(button_id),
            caption,
            _reference(press, "press"),
            _reference(long_press, "long_press"),
            _reference(up, "up"),
            int(uninterruptible),
        )


class JoystickTable(Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """Stored assignment of macros to buttons."""

    table_id: Annotated[I32, Meta(description="0 in a response: no such table")]
    table_caption: Caption = ""
    buttons: Annotated[tuple[Button, ...], U16_COUNT] = ()

    @staticmethod
    def of(caption: str, *buttons: Button, table_id: int = 0) -> JoystickTable:
        """Return the table of `buttons`; for the id 0, `build_project` assigns an id."""
        return JoystickTable(as_number(table_id), caption, buttons)


def _reference(macro: object, name: str) -> int:
    if macro is None:
        return 0
    if not isinstance(macro, Macro):
        raise EncodeError(f"must be a Macro, as made by Macro.of(caption, ...), not {quote(macro)}", name)
    return RecordRef.of(macro)


class MacroPlaying(Struct, frozen=True):
    """Player of macros without a clock: movements are passed to `move`, and each pause is yielded in seconds.

    All steps of an action start together, and the action lasts as long as the longest step. A ratio of 50 doubles the
    duration of a command, delays included. A command lasts `total_interval`, or as long as its contents if longer.
    """

    actions: Mapping[int, Action]
    macros: Mapping[int, Macro]
    move: Callable[[tuple[Step, ...], float], None]
    """Takes the steps to start now, and the speed: 0.5 doubles the interval of each step."""
    slowness: float = 1.0
    """Factor of an interval on the board to the interval in the document."""

    def play(self, macro_id: int, speed: float = 1.0) -> Generator[float, None, float]:
        """Run a macro, yielding each pause in seconds; return the total duration in seconds.

        Every record needed must be present, no macro may run itself, and no ratio may be 0.
        """
        total = 0.0
        for command in self.macros[macro_id].commands:
            yield 0.0
            elapsed = 0.0
            for _ in range(command.loop):
                elapsed += yield from self._play_once(command, speed * command.ratio / 100)
            rest = command.total_interval / 1000 / speed - elapsed
            if rest > 0:
                yield rest
            total += max(rest, 0.0) + elapsed
        return total

    def _play_once(self, command: MacroCommand, speed: float) -> Generator[float, None, float]:
        if command.type == MacroCommandType.MACRO:
            yield 0.0  # makes nested loops without any duration count as work, too, and interruptible
            return (yield from self.play(command.command_id, speed))
        if command.type == MacroCommandType.DELAY:
            duration = command.command_id / 1000 / speed
        else:
            action = self.actions[command.command_id]
            self.move(action.steps, speed)
            duration = action.seconds * self.slowness / speed
        yield duration
        return duration
