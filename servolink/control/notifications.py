"""The notifications of the control interface, each declared once."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Struct

from servolink.control.status import ConnectionState, HoldStatus, LeaseStatus, ServoNow, about
from servolink.errors import Reason
from servolink.project import Phase
from servolink.protocol import Packet, SendDummyDataRequest

_STOP_HEARD = b"servolink: stop heard: "
_MOST_DIGITS = 20  # of the number of a stop


class ServosFrame(Struct, frozen=True):
    """Latest reading of the servos, after `servos.watch`. Acknowledge each with `servos.ack`."""

    number: Annotated[int, about("counts up")]
    seconds: Annotated[float, about("when they were read; only differences have a meaning")]
    servos: tuple[ServoNow, ...]
    missed: Annotated[int, about("number of readings left out before")]


class ButtonPressed(Struct, frozen=True):
    """Button event, after `buttons.subscribe`."""

    button_id: int
    event: Annotated[int, about("1 press, 2 long press, 4 up")]
    kind: Annotated[str, about("the event in words")]


class ConnectionNow(Struct, frozen=True):
    """Change of the connection to the board; or a different board answers while the connection is lost."""

    state: ConnectionState
    another: Annotated[
        str, about("description of a different board in place of the lost one, and of the expected one; else empty")
    ] = ""


class LeaseNotice(Struct, frozen=True):
    """Change of the lease, or a program asks for the lease."""

    event: Annotated[str, about("taken, taken over, asked for, given back, left, over, beats stopped")]
    by: Annotated[str | None, about("program that took the lease or asks for the lease")]
    lease: LeaseStatus | None


class HoldNotice(Struct, frozen=True):
    """Begin of exclusive use of the board by a program; null for its end."""

    hold: HoldStatus | None


class StoppedNotice(Struct, frozen=True):
    """Stop of all servos by another program or the hub. Motions that were planned before must not follow."""

    by: Annotated[str | None, about("the program; null: the hub")]
    reason: Annotated[str, about("for people; empty from an earlier hub")] = ""
    stalled: Annotated[int | None, about("servo that the guard found stalled; null for any other reason")] = None
    number: Annotated[int | None, about("for `stop.heard`; null from an earlier hub")] = None

    @staticmethod
    def heard(number: int) -> SendDummyDataRequest:
        """Return the packet by which a program acknowledges a stop among its frames, where no motion can overtake it.

        The hub reads the packet, and sends nothing to the board.
        """
        return SendDummyDataRequest(_STOP_HEARD + b"%d" % number)

    @staticmethod
    def number_heard(packet: Packet) -> int | None:
        """Return the number of the stop that `packet` acknowledges; None for any other packet."""
        if not isinstance(packet, SendDummyDataRequest) or not packet.data.startswith(_STOP_HEARD):
            return None
        number = packet.data[len(_STOP_HEARD) :]
        return int(number) if number.isdigit() and len(number) < _MOST_DIGITS else None


class ProgramNotice(Struct, frozen=True):
    """Arrival, departure or new name of a program; sent to programs that have called `status`."""

    event: Literal["joined", "left", "renamed"]
    session: str
    who: str
    door: Annotated[
        str | None, about("door of the program: share, tcp, pty or local; null unless the program joined")
    ] = None
    role: Annotated[str | None, about("null unless the program joined")] = None


class ProgressNotice(Struct, frozen=True):
    """Progress of a request: export, plan, apply, rollback, and changes of records."""

    id: Annotated[int | str | None, about("the id of the request")]
    phase: Phase
    done: int
    total: Annotated[int, about("items of this phase")]
    item: Annotated[str, about("such as `action 3`")]


class RefusedNotice(Struct, frozen=True):
    """Unsent packet of this program, with the reason."""

    packet: Annotated[str, about("such as `ExecuteActionRequest`")]
    reason: Annotated[str, about("for people")]
    cause: Annotated[str, about("for programs, as `reason` in the data of an error")] = Reason.OTHER.value


class ProblemNotice(Struct, frozen=True):
    """Problem that needs the attention of a person."""

    text: str


class QuestionNotice(Struct, frozen=True):
    """Question of a program to a person, after `question.show`, whether it may move the robot.

    With neither `targets` nor `record`, all servos would be started after a stop.
    """

    number: Annotated[int, about("for `question.answer`")]
    who: Annotated[str, about("the program")]
    seconds: Annotated[float, about("planned duration of the motion")]
    targets: Annotated[dict[str, float], about("degrees by servo id, of a movement; else empty")] = {}
    record: Annotated[Literal["action", "macro"] | None, about("type of a stored record to run; else null")] = None
    caption: Annotated[str, about("caption of the record, or its id")] = ""
    warning: Annotated[str, about("what a forecast says of the motion")] = ""


class QuestionOver(Struct, frozen=True):
    """End of a question, with or without an answer."""

    number: int


class RecordingNotice(Struct, frozen=True):
    """Start, stop or mark of the recording of the hub; `recorder.status` returns the state."""

    event: Literal["started", "stopped", "marked"]
    who: str
    name: Annotated[str, about("of the file")]
    text: Annotated[str, about("of a mark")] = ""


class TapItem(Struct, frozen=True):
    """Message of the tap, in the form of a recording."""

    seconds: Annotated[float, about("time of the frame; only differences have a meaning")]
    channel: Annotated[str, about("/wire, /commands, /events or /problems")]
    message: Annotated[Any, about("as in a recording; bytes are in base64")]


class TapFrame(Struct, frozen=True):
    """Messages that have passed through the hub, after `tap.start`."""

    items: tuple[TapItem, ...]


NOTIFICATIONS: dict[str, type[Struct]] = {
    "servos": ServosFrame,
    "button": ButtonPressed,
    "connection": ConnectionNow,
    "lease": LeaseNotice,
    "hold": HoldNotice,
    "stopped": StoppedNotice,
    "program": ProgramNotice,
    "progress": ProgressNotice,
    "question": QuestionNotice,
    "question.over": QuestionOver,
    "recording": RecordingNotice,
    "tap": TapFrame,
    "refused": RefusedNotice,
    "problem": ProblemNotice,
}
"""The notifications, by the name of their method."""

NAMES = {notification: name for name, notification in NOTIFICATIONS.items()}
"""The name of the method of each notification."""
