"""The notifications of the control interface, each declared once."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Struct

from servolink.control.status import ConnectionState, HoldStatus, LeaseStatus, ServoNow, about
from servolink.project.transfer.results import Phase


class ServosFrame(Struct, frozen=True):
    """The latest state of the servos, after `servos.watch`. Acknowledge it with `servos.ack`."""

    number: Annotated[int, about("counts up")]
    seconds: Annotated[float, about("when they were read; only differences have a meaning")]
    servos: tuple[ServoNow, ...]
    missed: Annotated[int, about("readings left out directly before this one")]


class ButtonPressed(Struct, frozen=True):
    """A button event, after `buttons.subscribe`."""

    button_id: int
    event: Annotated[int, about("1 press, 2 long press, 4 up")]
    kind: Annotated[str, about("the event in words")]


class ConnectionNow(Struct, frozen=True):
    """The hub's connection to the board has changed, or another board answers while it is lost."""

    state: ConnectionState
    another: Annotated[str, about("who answers in place of the lost board, and who is expected; empty: nobody")] = ""


class LeaseNotice(Struct, frozen=True):
    """The lease has changed, or somebody asks for it."""

    event: Annotated[str, about("taken, taken over, asked for, given back, left, over, beats stopped")]
    by: Annotated[str | None, about("the program that took it or asks for it")]
    lease: LeaseStatus | None


class HoldNotice(Struct, frozen=True):
    """A program has the board alone from now on; null: it does not any more."""

    hold: HoldStatus | None


class StoppedNotice(Struct, frozen=True):
    """Another program, or the hub, stops all servos: motions that this program has not sent yet should not follow."""

    by: Annotated[str | None, about("the program; null: the hub")]


class ProgramNotice(Struct, frozen=True):
    """A program has joined, left or changed its name; for programs that have called `status`."""

    event: Literal["joined", "left", "renamed"]
    session: str
    who: str
    door: Annotated[str | None, about("where it joined: share, tcp, pty or local; null unless it joined")] = None
    role: Annotated[str | None, about("null unless it joined")] = None


class ProgressNotice(Struct, frozen=True):
    """How far a request is: export, plan, apply, rollback, and changes of records."""

    id: Annotated[int | str | None, about("the id of the request")]
    phase: Phase
    done: int
    total: Annotated[int, about("items of this phase")]
    item: Annotated[str, about("such as `action 3`")]


class RefusedNotice(Struct, frozen=True):
    """A packet of this program was not sent to the board."""

    packet: Annotated[str, about("such as `ExecuteActionRequest`")]
    reason: str


class ProblemNotice(Struct, frozen=True):
    """Something that people should look at."""

    text: str


class RecordingNotice(Struct, frozen=True):
    """The recording of the hub was started, stopped or marked; call `recorder.status` for its state."""

    event: Literal["started", "stopped", "marked"]
    who: str
    name: Annotated[str, about("of the file")]
    text: Annotated[str, about("of a mark")] = ""


class TapItem(Struct, frozen=True):
    """One message."""

    seconds: Annotated[float, about("when it was; only differences have a meaning")]
    channel: Annotated[str, about("/wire, /commands, /events or /problems")]
    message: Annotated[Any, about("as in a recording; bytes are in base64")]


class TapFrame(Struct, frozen=True):
    """What has passed through the hub, after `tap.start`."""

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
    "recording": RecordingNotice,
    "tap": TapFrame,
    "refused": RefusedNotice,
    "problem": ProblemNotice,
}
"""The notifications, by the name of their method."""

NAMES = {notification: name for name, notification in NOTIFICATIONS.items()}
"""The name of the method of each notification."""
