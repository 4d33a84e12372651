"""Methods of the page for the twin: try a record with physics, and have all records judged. No board is touched."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import aclosing
from itertools import compress
from operator import not_
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct

from servolink.control import NoParams, ProjectForm, Role, Touches
from servolink.errors import NotFound
from servolink.project import Figure, Project, ProjectFile
from servolink.protocol import ACTION, MACRO, Action, Macro, RecordType
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.studio.studio_twin import Robot
from servolink.support import computed
from servolink.twin import Fall, Judged, Reached

Coordinate: TypeAlias = Annotated[float, Meta(ge=-10_000, le=10_000)]
ServoId: TypeAlias = Annotated[str, Meta(pattern="^[0-9]{1,3}$")]
Degree: TypeAlias = Annotated[float, Meta(ge=-720, le=720)]


class TwinProject(Struct, forbid_unknown_fields=True):
    """Project as edited, and the figure of its robot."""

    project: ProjectForm
    figure: Figure


class TwinRecord(TwinProject, forbid_unknown_fields=True):
    """Action or macro of a project."""

    type: Literal["action", "macro"]
    id: Annotated[int, Meta(ge=0)]


class TwinPull(Struct, forbid_unknown_fields=True):
    """Pull at the end of a limb."""

    figure: Figure
    joint: Annotated[str, Meta(max_length=200)]
    move: tuple[Coordinate, Coordinate, Coordinate]
    """Way of the tip of the joint, in millimetres, in the frame of the base of the figure."""
    start: dict[ServoId, Degree]
    """Degrees by servo id, before."""


class FallAt(Struct, frozen=True):
    """Fall of the robot."""

    seconds: float
    command: Annotated[int | None, Meta(description="number of the command of the macro, from 1")]


class TwinFrame(Struct, frozen=True):
    """Robot at a moment of a run."""

    frame: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    """Move of the base from rest (mm), its turn (quaternion w, x, y, z), and degrees of the servos by id."""


class Tried(Struct, frozen=True):
    """End of a run."""

    fall: FallAt | None


class RecordVerdict(Struct, frozen=True):
    """Verdict about a record."""

    type: str
    id: int
    verdict: str
    fall: FallAt | None


class Verdicts(Struct, frozen=True):
    """Verdicts about records of a project; a macro that no board could play has none."""

    verdicts: tuple[RecordVerdict, ...]


@METHODS.add("studio.twin.try", Role.WATCH, touches=Touches.NOTHING)
async def twin_try(caller: PageCaller, params: TwinRecord, report: Callable[[TwinFrame], None]) -> Tried:
    """Run a record on the twin, and report the robot 50 times a second.

    The run ends early with the next call of this method or of `studio.twin.stop` by the same page. TwinError says why
    there is no twin.
    """
    robot, record = await computed(_found)(params)
    twin = caller.studio.twin
    is_wanted = twin.begin(caller.page, "run")
    fall: Fall | None = None
    async with aclosing(twin.play(robot, record)) as frames:
        async for frame, last in frames:
            if not is_wanted():
                break
            fall = last
            report(TwinFrame((frame.at, frame.turn, frame.angles)))
    return Tried(_fall_at(fall))


def _found(params: TwinRecord) -> tuple[Robot, Action | Macro]:
    project = ProjectFile.of_form(params.project).project
    kind = ACTION if params.type == "action" else MACRO
    record = project.by_type()[kind.field].get(params.id)
    if record is None:
        raise NotFound(f"the project has no {kind.label} {params.id}")
    return Robot.of(project, params.figure), record


@METHODS.add("studio.twin.stop", Role.WATCH, touches=Touches.NOTHING)
def twin_stop(caller: PageCaller, params: NoParams) -> None:
    """End the run of this page on the twin."""
    caller.studio.twin.begin(caller.page, "run")


@METHODS.add("studio.twin.verdicts", Role.WATCH, touches=Touches.NOTHING)
async def twin_verdicts(caller: PageCaller, params: TwinProject, report: Callable[[Verdicts], None]) -> Verdicts:
    """Return the verdicts about all macros and actions, and report those known at once, and each that is made.

    The work ends early with the next call of this method by the same page. TwinError says why there is no twin.
    """
    robot = await computed(lambda: Robot.of(ProjectFile.of_form(params.project).project, params.figure))()
    twin = caller.studio.twin
    is_wanted = twin.begin(caller.page, "verdicts")
    records: list[Action | Macro] = [*robot.project.actions, *robot.project.macros]
    known = await computed(lambda: [twin.known(robot, record) for record in records])()
    found = list[RecordVerdict]()
    for record in compress(records, known):
        found += _verdicts(record, await twin.verdict(robot, record))
    report(Verdicts(tuple(found)))
    for record in compress(records, map(not_, known)):
        made = _verdicts(record, await twin.verdict(robot, record))
        if not is_wanted():
            break
        report(Verdicts(made))
        found += made
    return Verdicts(tuple(found))


@METHODS.add("studio.twin.reach", Role.WATCH, touches=Touches.NOTHING)
async def twin_reach(caller: PageCaller, params: TwinPull) -> Reached:
    """Return the angles with which a hand, a foot or a head goes where it was pulled, or as near as possible."""
    figure = (await computed(Robot.of)(Project(), params.figure)).figure
    start = {int(servo_id): degrees for servo_id, degrees in params.start.items()}
    return await caller.studio.twin.pull(figure, params.joint, params.move, start)


def _verdicts(record: Action | Macro, judged: Judged | None) -> tuple[RecordVerdict, ...]:
    """Return the verdict about a record, if there is one."""
    if judged is None:
        return ()
    kind = RecordType.of(record)
    return (RecordVerdict(kind.label, kind.id_of(record), judged.verdict, _fall_at(judged.fall)),)


def _fall_at(fall: Fall | None) -> FallAt | None:
    return None if fall is None else FallAt(round(fall.seconds, 2), fall.command)
