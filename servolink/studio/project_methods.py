"""The methods for project files and backups: the page has neither a file system nor the checks of the library."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from msgspec import Meta, Struct

from servolink.boards import ProfileInUse
from servolink.control import ProjectExported, ProjectForm, Role, Touches
from servolink.errors import ProjectError
from servolink.motion import INTERVAL_UNIT
from servolink.project import (
    BackupStore,
    CopiedMotions,
    Diagnostic,
    Figure,
    Mirror,
    PoseRecorder,
    Project,
    ProjectFile,
    extend_project,
    preflight,
    validate_project,
)
from servolink.protocol import CAPTION_SIZE, Action, Macro, RecordType, record_to_json
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.support import computed


class FileText(Struct, forbid_unknown_fields=True):
    """The text of a project file."""

    text: str


class SomeProject(Struct, forbid_unknown_fields=True):
    """Project, in the form of a project file."""

    project: ProjectForm


class Found(Struct, frozen=True):
    """Fault or oddity in a project."""

    path: str
    text: str
    severity: str
    """`error` for content that no board would store, otherwise `warning`."""


class Checked(Struct, frozen=True):
    """Findings, errors first."""

    found: tuple[Found, ...]


class BackupNumber(Struct, forbid_unknown_fields=True):
    """The number of a backup."""

    number: Annotated[int, Meta(ge=0)]


Id: TypeAlias = Annotated[str, Meta(pattern="^-?[0-9]{1,10}$")]
ById: TypeAlias = dict[Id, Annotated[str, Meta(max_length=256)]]
"""Captions by id."""
Angles: TypeAlias = Annotated[dict[Id, Annotated[int, Meta(ge=-0x7FFF, le=0x7FFF)]], Meta(max_length=256)]
"""Whole degrees by servo id."""
T = TypeVar("T")


class Sides(Struct, forbid_unknown_fields=True):
    """What tells the left of a robot from its right."""

    captions: ById
    """Captions of the servos."""
    figure: Figure | None = None


class LessonPose(Struct, forbid_unknown_fields=True):
    """Pose taken by hand."""

    degrees: Angles
    seconds: Annotated[float, Meta(ge=0, le=PoseRecorder.LONGEST)]
    """Time since the pose before."""


class PoseFilm(Struct, forbid_unknown_fields=True):
    """Film of poses, to become an action for each pose, and with several poses a macro."""

    name: str
    poses: Annotated[list[LessonPose], Meta(max_length=1000)]
    start: Angles
    """Pose before the first one."""
    caps: dict[Id, Annotated[float, Meta(ge=0.001, le=1e9)]]
    """Highest speed of each servo in the poses, degrees per second."""
    actions: ById
    """Captions of the actions that exist, likewise `macros`."""
    macros: ById
    may_repeat: bool = False
    """Whether other records may have the name."""


class LessonMade(Struct, frozen=True):
    """Times and records of a lesson."""

    seconds: tuple[float, ...]
    """Time for each pose, at least the one in `least_seconds`."""
    least_seconds: tuple[float, ...]
    refusal: Literal["", "name_long", "name_taken"]
    """Reason why there are no records."""
    actions: tuple[Any, ...] = ()
    """Records in the form of project files, likewise `macros`."""
    macros: tuple[Any, ...] = ()


class EasingAsk(Struct, forbid_unknown_fields=True):
    """Movement to be eased."""

    curve: Literal["linear", "soft", "snap"]
    start: Angles
    """Pose before."""
    end: Angles
    seconds: Annotated[float, Meta(ge=0, le=PoseRecorder.LONGEST)]
    error: Annotated[float, Meta(ge=1, le=90)]
    """Degrees from the curve, at most."""


class Eased(Struct, frozen=True):
    """Poses of a movement that is eased, or was seen."""

    poses: tuple[LessonPose, ...]
    worst: float
    """Largest distance from the curve, or from what was seen, degrees."""
    size_bytes: int
    """Size of the records on the board."""


Readings: TypeAlias = Annotated[list[Annotated[float, Meta(ge=-1e6, le=1e6)]], Meta(max_length=3000)]


class SeenMovement(Struct, forbid_unknown_fields=True):
    """Movement of the robot as it was seen."""

    times: Annotated[list[Annotated[float, Meta(ge=0, le=1e9)]], Meta(max_length=3000)]
    """Seconds, ascending."""
    angles: Annotated[dict[Id, Readings], Meta(max_length=32)]
    """Degrees of each servo at these times."""
    error: Annotated[float, Meta(ge=1, le=90)]
    """Degrees from what was seen, at most."""
    lead: Annotated[float, Meta(ge=0.1, le=10)]
    """Seconds to the first pose."""


class CopiedText(SomeProject, forbid_unknown_fields=True):
    """Text from a clipboard, and how motions in the text are to fit this robot."""

    text: Annotated[str, Meta(max_length=500_000)]
    servos: Annotated[list[CopiedMotions.NamedServo], Meta(max_length=512)]
    """Servos of this robot."""
    pairs: dict[Id, Annotated[int, Meta(ge=0, le=255)]] | None = None
    """Servo of this robot for each servo of the other; by default, by names."""
    mirror: Sides | None = None
    """What tells left from right, if the motions are to be mirrored."""
    percent: Annotated[int, Meta(ge=1, le=10_000)] = 100
    """Times, in percent of those that were copied."""


class Pasted(Struct, frozen=True):
    """Motions as they fit this robot."""

    servos: tuple[CopiedMotions.NamedServo, ...] = ()
    """Servos of the other robot."""
    pairs: dict[int, int] = {}
    names: tuple[str, ...] = ()
    """Captions of the motions; no names for a text that no studio has copied."""
    left: tuple[str, ...] = ()
    """Actions left out, because no servo has a partner."""
    actions: tuple[Any, ...] = ()
    """Records to be added, in the form of project files, likewise `macros`."""
    macros: tuple[Any, ...] = ()


class Images(Struct, frozen=True):
    """Mirror images of servos by servo id."""

    images: dict[int, Mirror.ServoImage]


@METHODS.add("project.images", Role.WATCH, touches=Touches.NOTHING)
@computed
def images(caller: PageCaller, params: Sides) -> Images:
    """Return the mirror image of each servo that has one."""
    return Images(Mirror.images(params.figure, _by_id(params.captions)))


@METHODS.add("project.lesson", Role.WATCH, touches=Touches.NOTHING)
@computed
def lesson(caller: PageCaller, params: PoseFilm) -> LessonMade:
    """Return the times of poses taken by hand, and the records made of them. ProjectError if no board stores them."""
    recorder = PoseRecorder(params.name, _by_id(params.start), 0, speed_cap=_by_id(params.caps))
    least, now = [], 0.0
    for pose in params.poses:
        least.append(recorder.least_seconds(_by_id(pose.degrees)))
        now += pose.seconds
        recorder.take(_by_id(pose.degrees), now)
    seconds = tuple(pose.seconds for pose in recorder.poses)
    before = Project(
        actions=tuple(Action(*each) for each in _by_id(params.actions).items()),
        macros=tuple(Macro(*each) for each in _by_id(params.macros).items()),
    )
    number = f" {len(seconds)}" if len(seconds) > 1 else ""
    if len(f"{params.name}{number}".encode(errors="replace")) > CAPTION_SIZE:
        return LessonMade(seconds, tuple(least), "name_long")
    try:
        if not params.may_repeat:
            PoseRecorder.refuse_duplicate(before, params.name)
    except ProjectError:
        return LessonMade(seconds, tuple(least), "name_taken")
    after = extend_project(before, recorder.record()) if seconds and params.name else before
    return LessonMade(seconds, tuple(least), "", *_added(before, after))


@METHODS.add("project.ease", Role.WATCH, touches=Touches.NOTHING)
@computed
def ease(caller: PageCaller, params: EasingAsk) -> Eased:
    """Return a movement along a curve as poses that a board reaches one after another."""
    start, end = _by_id(params.start), _by_id(params.end)
    return _eased(*PoseRecorder.eased(params.curve, start, end, params.seconds, params.error))


@METHODS.add("project.thin", Role.WATCH, touches=Touches.NOTHING)
@computed
def thin(caller: PageCaller, params: SeenMovement) -> Eased:
    """Return a movement that was seen as few poses. ProjectError unless times ascend, with an angle of each servo."""
    angles = _by_id(params.angles)
    is_whole = all(len(row) == len(params.times) for row in angles.values())
    if not is_whole or any(later <= earlier for earlier, later in pairwise(params.times)):
        raise ProjectError("times must ascend, and each servo must have an angle at each time; record again")
    return _eased(*PoseRecorder.thinned(params.times, angles, params.error, params.lead))


@METHODS.add("project.paste", Role.WATCH, touches=Touches.NOTHING)
@computed
def paste(caller: PageCaller, params: CopiedText) -> Pasted:
    """Return the motions in a text from a clipboard as they fit this robot. ProjectError for a time too long."""
    try:
        copied = CopiedMotions.parse(params.text)
    except ValueError:
        return Pasted()
    before = ProjectFile.of_form(params.project).project
    pairs = copied.pairs(params.servos) if params.pairs is None else _by_id(params.pairs)
    mirrored = Mirror.images(params.mirror.figure, _by_id(params.mirror.captions)) if params.mirror else {}
    images = {theirs: mirrored.get(ours, Mirror.ServoImage(ours, 1, 0)) for theirs, ours in pairs.items()}
    after, left = copied.pasted(before, images, params.percent / 100)
    names = tuple(RecordType.of(one).caption_of(one) for one in (*copied.records.macros, *copied.records.actions))
    return Pasted(copied.servos, pairs, names, tuple(left), *_added(before, after))


def _added(before: Project, after: Project) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    actions = [record_to_json(one) for one in after.actions if one not in before.actions]
    macros = [record_to_json(one) for one in after.macros if one not in before.macros]
    return tuple(actions), tuple(macros)


def _eased(recorder: PoseRecorder, worst: float) -> Eased:
    poses = [LessonPose({str(each): at for each, at in pose.degrees.items()}, pose.seconds) for pose in recorder.poses]
    size = extend_project(Project(), recorder.record()).total_size() if poses else 0
    return Eased(tuple(poses), worst, size)


def _by_id(values: Mapping[str, T]) -> dict[int, T]:
    return {int(number): value for number, value in values.items()}


@METHODS.add("studio.file.read", Role.WATCH, touches=Touches.NOTHING)
@computed
def file_read(caller: PageCaller, params: FileText) -> ProjectExported:
    """Return the project in the text of a file. ProjectError names the fault and the place."""
    return ProjectExported(ProjectFile.parse(params.text).form())


@METHODS.add("studio.file.write", Role.WATCH, touches=Touches.NOTHING)
@computed
def file_write(caller: PageCaller, params: SomeProject) -> FileText:
    """Return the text of the file for a project, as `servolink export` writes it."""
    return FileText(ProjectFile.of_form(params.project).text())


@METHODS.add("studio.check", Role.WATCH, touches=Touches.NOTHING)
@computed
def check(caller: PageCaller, params: SomeProject) -> Checked:
    """Return faults and oddities of a project, and movements too fast or too far for the board."""
    found = findings(ProjectFile.of_form(params.project).project, caller.profile)
    ordered = sorted(found, key=lambda one: one.severity != "error")
    return Checked(tuple(Found(one.path, one.text, one.severity) for one in ordered))


def findings(project: Project, profile: ProfileInUse | None) -> list[Diagnostic]:
    """Return faults and oddities of a project on a board with this profile."""
    found = validate_project(project)
    if any(one.severity == "error" for one in found):  # such as endless macros, which take no time
        return found
    if profile is None:
        return found
    interval_unit = profile.settings.interval_unit or INTERVAL_UNIT
    return found + preflight(project, limits=profile.limits, interval_unit=interval_unit)


@METHODS.add("studio.backup", Role.EDIT, touches=Touches.NOTHING)
@computed
def backup(caller: PageCaller, params: BackupNumber) -> ProjectExported:
    """Return the content of a backup. ProjectError for an unknown number or a changed backup."""
    store = BackupStore()
    path = next((one.path for one in store.backups() if one.number == params.number), None)
    if path is None:
        raise ProjectError(f"there is no backup {params.number}; look at the list of backups again")
    project = store.load(path)
    is_odd = any(one.severity == "error" for one in validate_project(project))
    return ProjectExported(ProjectFile(project, unchecked=is_odd).form())
