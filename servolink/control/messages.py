"""Params and results of the control interface that more than the hub knows; `hub.method_messages` has the others.

The checks of messages from programs, the reference page and the JSON Schema are made from these types. Units are in the
names or in the descriptions; records and projects have the form of project files.
"""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from msgspec import Struct, defstruct

from servolink.control.status import ConnectionState, LeaseStatus, ServoNow, about
from servolink.project import ProjectFile
from servolink.protocol import RECORD_TYPES, json_type

RecordKind = Literal["action", "macro", "joystick_table"]
"""Names of the types of stored records."""


Which: TypeAlias = Annotated[int | str, about("an id, or a caption")]


class NoParams(Struct, forbid_unknown_fields=True):
    """Params of a method without any params."""


class Done(Struct, frozen=True):
    """Result of a method that returns nothing."""


class LeaseNow(Struct, frozen=True):
    """Program with the lease; null if the lease is free."""

    lease: LeaseStatus | None


class Tapping(Struct, frozen=True):
    """Active tap: time, codec and connection of the hub."""

    seconds: Annotated[float, about("now, on the clock of the messages")]
    byte_order: Literal["little", "big"]
    caption_encoding: str
    state: Annotated[ConnectionState, about("the hub's connection to the board")]


class ServoList(Struct, frozen=True):
    """All servos with their latest readings."""

    servos: tuple[ServoNow, ...]


class Battery(Struct, frozen=True):
    """Remaining charge of the board's battery."""

    percent: Annotated[float | None, about("to 0.1; null if the board does not measure it")]


class Answer(Struct, frozen=True):
    """Answer of a person to a question."""

    is_yes: bool
    by: Annotated[str, about("program at which the person answered")]


class StreamBegun(Struct, frozen=True):
    """Stream of set-points that has begun."""

    stream: Annotated[int, about("number of the stream, for `stream.send`")]


class StreamSent(Struct, frozen=True):
    """Angles sent in place of a set-point."""

    sent: Annotated[dict[str, int], about("degrees by servo id, within the limits; empty: a newer set-point came")]


class Runnable(Struct, forbid_unknown_fields=True):
    """Action or macro stored on the board."""

    type: Literal["action", "macro"]
    id: Which


class Ran(Struct, frozen=True):
    """Planned duration of an action; null for a macro."""

    seconds: float | None


class RunStarted(Struct, frozen=True):
    """Start of a run prepared by `run.prepare`."""

    monotonic: Annotated[float, about("seconds; when it was sent to the board, by the clock of the hub's computer")]


class RecordEntry(Struct, frozen=True):
    """Stored record without its content."""

    type: RecordKind
    id: int
    caption: str


class RecordList(Struct, frozen=True):
    """Stored records, in the order of the board."""

    records: tuple[RecordEntry, ...]


if TYPE_CHECKING:
    AnyRecord: TypeAlias = Any
    ProjectForm: TypeAlias = Any
else:
    AnyRecord = reduce(
        or_,
        [
            defstruct(
                f"{_type.record_class.__name__}Record",
                [("record", Annotated[json_type(_type.record_class, unchecked=True), about(_type.label)])],
                namespace={
                    "__doc__": f"A stored {_type.label}, or a new one, which gets the lowest free id in place of 0."
                },
                module=__name__,
                forbid_unknown_fields=True,
                tag=_type.label.replace(" ", "_"),
                tag_field="type",
            )
            for _type in RECORD_TYPES
        ],
    )
    ProjectForm = ProjectFile.form_type(unchecked=True)


class ProjectExported(Struct, frozen=True):
    """Project with everything that is stored on the board."""

    project: ProjectForm


class Applied(Struct, frozen=True):
    """Outcome of an import into the board."""

    changed: Annotated[bool, about("false: the board held the project already")]
    resumed: Annotated[bool, about("continues an interrupted import")]
    backup: Annotated[str | None, about("file with what the board held before")]
    project_id_bits: Annotated[Literal[32, 16, 0] | None, about("bits of the project id that the board keeps")]
