"""Params and results of the methods of a hub; `servolink.control` has those that other rooms read or write, too.

The checks of messages from programs, the reference page and the JSON Schema are made from these types. Units are in the
names or in the descriptions; records and projects have the form of project files.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from msgspec import Meta, Struct

from servolink.client import ServoStream
from servolink.control import HoldStatus, ProjectForm, RecordKind, Runnable, Tighten, about
from servolink.motion import AngleUnit
from servolink.protocol import ServoParameter

MOST_HZ = 200.0
MOST_LIMITS = 64
"""Most limits in addition to those of the board: each movement of a servo is compared with all limits."""
CREDIT = 2
"""Unacknowledged frames of servos after which a program gets no further frames."""
_MOST_SERVOS = 255

Servos: TypeAlias = Annotated[int | str, about('an id, a caption, or "all"')]
_ServoId: TypeAlias = Annotated[int, Meta(ge=0, le=254)]
AnyAngle = Annotated[
    bool, about("allow angles beyond ±360 degrees for servos without limits, and servos with impossible readings")
]
Until: TypeAlias = Annotated[
    float | None,
    about("seconds on the clock of `monotonic`, after which the motion does not begin; null for any time"),
]


# --- the lease and the hold -------------------------------------------------------------------------------------------


class LeaseTake(Struct, forbid_unknown_fields=True):
    """Options for taking the lease."""

    force: Annotated[bool, about("take the lease over from another program, which is told by whom")] = False
    dead_man: Annotated[
        Annotated[float, Meta(ge=0.1, le=60)] | None,
        about("seconds without lease.beat after which the hub stops the board; null: as in the greeting"),
    ] = None


class StopHeard(Struct, forbid_unknown_fields=True):
    """Stop that the program has heard of."""

    number: Annotated[Annotated[int, Meta(ge=0)], about("number of the notification, or `stops` of the welcome")]


class ExclusiveUse(Struct, forbid_unknown_fields=True):
    """Reason for exclusive use of the board."""

    reason: Annotated[str, Meta(max_length=200, description="for the people whose programs wait")] = ""


class Rename(Struct, forbid_unknown_fields=True):
    """New name of a program."""

    who: Annotated[str, Meta(max_length=200, description="for the people who use other programs")]


class ExclusiveUseNow(Struct, frozen=True):
    """Program with exclusive use of the board; null if there is none."""

    hold: HoldStatus | None


# --- servos -----------------------------------------------------------------------------------------------------------


class ServosWatch(Struct, forbid_unknown_fields=True):
    """Rate and filter of servo readings."""

    hz: Annotated[float, Meta(gt=0, le=MOST_HZ, description="notifications per second, at most")] = 25.0
    changed_only: Annotated[bool, about("leave out servos without a change since the last reading")] = False


class TapStart(Struct, forbid_unknown_fields=True):
    """Filter of the frames in a tap."""

    wire_only: Annotated[bool, about("only bytes")] = False


class RecorderStart(Struct, forbid_unknown_fields=True):
    """Content and size of a new recording."""

    hz: Annotated[float, Meta(ge=0, le=MOST_HZ, description="readings of the servos a second; 0: none")] = 20.0
    wire_only: Annotated[bool, about("only bytes")] = False


class RecorderMark(Struct, forbid_unknown_fields=True):
    """Mark of a moment in a recording."""

    text: Annotated[str, Meta(max_length=200)] = ""


class RecordingNow(Struct, frozen=True):
    """Current recording of the hub, or the latest one."""

    is_recording: bool
    name: Annotated[str, about("of the file; empty before the first recording")] = ""
    file: Annotated[str, about("the whole path, on the computer of the hub")] = ""
    seconds: float = 0.0
    size_bytes: Annotated[int, about("on the disk")] = 0
    messages: int = 0
    dropped: Annotated[int, about("messages that are missing")] = 0
    problem: Annotated[str, about("why nothing can be written now; empty if all is well")] = ""


class RecordingEntry(Struct, frozen=True):
    """Recording in the folder of the hub's user."""

    name: str
    size_bytes: int
    ended: Annotated[str, about("ISO 8601, UTC")]


class RecordingList(Struct, frozen=True):
    """All recordings, the newest last."""

    folder: str
    recordings: tuple[RecordingEntry, ...]


class ServosAck(Struct, forbid_unknown_fields=True):
    """Acknowledgement of a notification of servo readings."""

    number: Annotated[int, Meta(ge=0, description="`number` of a notification `servos`; acknowledges earlier ones too")]


class Watching(Struct, frozen=True):
    """Active subscription to servo readings."""

    hz: float
    credit: Annotated[int, about("how many notifications may be unacknowledged")] = CREDIT


class ServosList(Struct, forbid_unknown_fields=True):
    """Unit of the angles to read."""

    unit: Annotated[AngleUnit, about("degrees, or raw ADC readings")] = "degree"


class ServoParameters(Struct, frozen=True):
    """Stored parameters of the servos."""

    servos: tuple[ServoParameter, ...]


# --- settings ---------------------------------------------------------------------------------------------------------


class BoardFacts(Struct, frozen=True):
    """Identity and memory of the board. Null for a query that the board does not answer."""

    servo_ids: tuple[int, ...]
    project_id: Annotated[int | None, about("0 for none; null during an unfinished import too")]
    is_unfinished: Annotated[bool, about("the board holds an unfinished import")]
    memory_free: Annotated[int | None, about("bytes, if the profile has the unit; null if the board does not measure")]
    memory_total: Annotated[int | None, about("in the same unit; null if the board does not report it")]


class BoardMode(Struct, forbid_unknown_fields=True):
    """Transmission mode of the board."""

    mode: Annotated[Literal[0, 1], about("1 for this protocol, 0 for an older protocol")]


class LineTest(Struct, forbid_unknown_fields=True):
    """Size of the test data."""

    size: Annotated[int, Meta(ge=0, le=4096, description="bytes of test data")] = 64


class LineTested(Struct, frozen=True):
    """Outcome of a query after test data."""

    seconds: Annotated[float | None, about("until the response; null if the query was not answered")]
    repeats: Annotated[int, about("requests that were sent again meanwhile, of any program")]
    noise: Annotated[int, about("bytes outside any frame meanwhile")]


class Move(Struct, forbid_unknown_fields=True):
    """Movement with either `duration` or `speed`."""

    targets: Annotated[
        dict[str, float], Meta(max_length=_MOST_SERVOS, description="degrees by servo: id or caption as text")
    ]
    duration: Annotated[float | None, about("seconds")] = None
    speed: Annotated[float | None, about("degrees per second")] = None
    wait: Annotated[bool, about("respond when the servos have arrived")] = False
    dry_run: Annotated[bool, about("check everything, and move nothing")] = False
    start: Annotated[bool, about("start and hold servos first that are stopped or released")] = False
    any_angle: AnyAngle = False
    until: Until = None


class Moved(Struct, frozen=True):
    """Planned duration of a motion in seconds."""

    seconds: float


class MoveEnd(Struct, forbid_unknown_fields=True):
    """Servos to stop at their present angles."""

    servos: Annotated[
        Annotated[tuple[_ServoId, ...], Meta(max_length=_MOST_SERVOS)] | None,
        about("ids of the servos that may move; null: all servos"),
    ] = None


class Release(Struct, forbid_unknown_fields=True):
    """Servos to release, limp from then on."""

    servo: Servos = "all"
    until: Until = None


class ServoSet(Struct, forbid_unknown_fields=True):
    """New state of a servo."""

    servo: Servos
    start: Annotated[bool, about("whether it may move")]
    hold: Annotated[bool, about("whether it holds its angle")]
    until: Until = None


# --- questions to a person --------------------------------------------------------------------------------------------


class QuestionAsk(Struct, forbid_unknown_fields=True):
    """Motion about which a person is asked: targets, a stored record, or neither for the start of all servos."""

    seconds: Annotated[float, Meta(ge=0, le=3600, description="planned duration of the motion")]
    targets: Annotated[
        dict[Annotated[str, Meta(max_length=64)], float],
        Meta(max_length=_MOST_SERVOS, description="degrees by servo id, of a movement"),
    ] = {}
    record: Annotated[Literal["action", "macro"] | None, about("type of a stored record to run")] = None
    caption: Annotated[str, Meta(max_length=200, description="caption of the record, or its id")] = ""
    warning: Annotated[str, Meta(max_length=1000, description="what a forecast says of the motion")] = ""


class AnswerGiven(Struct, forbid_unknown_fields=True):
    """Answer to a question of another program."""

    number: Annotated[int, about("of the notification `question`")]
    is_yes: bool


# --- streams ----------------------------------------------------------------------------------------------------------


class StreamBegin(Struct, forbid_unknown_fields=True):
    """Rate, gap and further limits of a stream of set-points."""

    hz: Annotated[float, Meta(gt=0, le=ServoStream.MOST_HZ, description="set-points per second, at most")] = 50.0
    gap: Annotated[
        float, Meta(gt=0, le=ServoStream.MOST_GAP, description="seconds without a set-point that end the stream")
    ] = 0.5
    limits: Annotated[
        tuple[Tighten, ...], Meta(max_length=MOST_LIMITS, description="limits in addition to those of the board")
    ] = ()
    any_angle: AnyAngle = False


class StreamSend(Struct, forbid_unknown_fields=True):
    """Set-point for a stream of this program."""

    stream: Annotated[int, about("number of the stream, from `stream.begin`")]
    targets: Annotated[
        dict[str, float], Meta(max_length=_MOST_SERVOS, description="degrees by servo: id or caption as text")
    ]


class Run(Runnable, forbid_unknown_fields=True):
    """Stored action or macro to run, with options."""

    wait: Annotated[bool, about("respond when the motion is over")] = False
    dry_run: Annotated[bool, about("check everything, and move nothing")] = False
    any_angle: Annotated[bool, about("move servos whose readings cannot be true, too")] = False
    until: Until = None


class RunPrepare(Runnable, forbid_unknown_fields=True):
    """Stored action or macro to check and to keep ready."""

    until: Until = None


class MotionCheck(Struct, forbid_unknown_fields=True):
    """Motion to try on the twin of the hub."""

    frame: Annotated[str, Meta(max_length=8192, pattern="^([0-9a-f]{2})+$", description="frame of the motion, in hex")]


class RunStart(Struct, forbid_unknown_fields=True):
    """Time at which a prepared run begins."""

    at: Annotated[
        float | None,
        about("seconds, by the clock that `monotonic` tells; at most 1 s ahead; at once for a past time or null"),
    ] = None


class RecordsList(Struct, forbid_unknown_fields=True):
    """Type of the records to list."""

    type: Annotated[RecordKind | None, about("null for all types")] = None


class RecordsGet(Struct, forbid_unknown_fields=True):
    """Type and id of a stored record."""

    type: RecordKind
    id: Annotated[int | str, about("an id, or a caption")]


class RecordStored(Struct, frozen=True):
    """Stored record with its id."""

    type: RecordKind
    id: int
    changed: Annotated[bool, about("false: it was stored already")]
    backup: Annotated[str | None, about("file with what the board held before")]


class ProjectPlan(Struct, forbid_unknown_fields=True):
    """Project to compare the board with."""

    project: ProjectForm
    replace: Annotated[bool, about("delete everything first, and write all of it")] = False


class ProjectApply(ProjectPlan, forbid_unknown_fields=True):
    """Project to store on the board."""

    backup: Annotated[bool, about("save what the board holds first")] = True


class ProjectRollback(Struct, forbid_unknown_fields=True):
    """Backup to restore on the board."""

    backup: Annotated[int | None, about("the number of a backup; null: what was there before the last import")] = None


class Changed(Struct, frozen=True):
    """Difference between board and project."""

    what: Annotated[str, about("such as `action 3` or `project id`")]
    old: Annotated[Any, about("null for an added record")]
    new: Annotated[Any, about("null for a removed record")]


class MemoryNow(Struct, frozen=True):
    """Memory of the board in bytes."""

    unit_bytes: Annotated[int | None, about("the unit in which the board counts; null if it is unknown")]
    size_bytes: int | None
    free_before_bytes: int
    free_after_bytes: int
    warning: str | None


class Planned(Struct, frozen=True):
    """Planned import of a project, with its cost."""

    changes: tuple[Changed, ...]
    inconsistencies: Annotated[tuple[str, ...], about("faults that an import repairs too")]
    requests: int
    wire_bytes: int
    estimated_seconds: float
    memory: MemoryNow | None
    is_unfinished: Annotated[bool, about("the board holds an unfinished import")]


class BackupEntry(Struct, frozen=True):
    """Backup of a board before an import."""

    number: int
    time: Annotated[str, about("ISO 8601, UTC")]
    board: str
    file: str


class BackupList(Struct, frozen=True):
    """All backups, the newest last."""

    backups: tuple[BackupEntry, ...]
