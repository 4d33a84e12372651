"""Search for movements beyond the speed caps or angle limits, before a servo moves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from servolink.motion import INTERVAL_UNIT, AngleLimits, MotionLimits, SpeedCap, motion_limits
from servolink.project.model import Project, name_of
from servolink.project.record_lookup import dependency_order
from servolink.project.speed import RecordRun
from servolink.project.validate import Diagnostic, duplicates, too_fast
from servolink.protocol import ACTION, MACRO, Action, MacroCommandType, Record


def preflight(
    project: Project,
    records: Iterable[Record] | None = None,
    *,
    speed_cap: SpeedCap | None = None,
    angle_limits: AngleLimits | None = None,
    limits: MotionLimits | None = None,
    interval_unit: float = INTERVAL_UNIT,
    start: Mapping[int, int] | None = None,
) -> list[Diagnostic]:
    """Return where movements of a project exceed `speed_cap`, `angle_limits` or `limits`.

    Args:
        project: Project to check.
        records: Actions and macros to check, together with all records run by them; None for the whole project.
        speed_cap: Highest speed in degrees per second, for all servos or by servo id.
        angle_limits: Lowest and highest angle in degrees, for all servos or by servo id.
        limits: Further limits, such as `board.profile.limits`.
        interval_unit: Seconds of an interval of 1.
        start: Pose before the first movement, degrees by servo id; without a pose, first movements are not checked.

    Raises:
        ProjectError: An id is used twice.
        EncodeError: The limits permit no value at all.
    """
    all_limits = motion_limits(angle_limits, speed_cap).tightened(limits or MotionLimits())
    found = [*_beyond_limits(project, all_limits), *too_fast(project, all_limits, start, interval_unit)]
    if records is None:
        return found
    selected = project.with_dependencies(records)
    places = {
        f"{kind.field}[{at}]"
        for kind in (ACTION, MACRO)
        for at, record in enumerate(getattr(project, kind.field))
        if record in selected
    }
    return [one for one in found if one.path.partition(".")[0] in places]


def uncheckable(stored: Project) -> Iterator[str]:
    """Yield faults of stored records with an unknown effect on the movement: the document leaves the effect open."""
    for action in stored.actions:
        for twice in duplicates(action.steps):
            servo_id = action.steps[twice.at].servo_id
            yield f"{name_of(action)} moves servo {servo_id} twice, and boards differ in which step counts"
    for macro in stored.macros:
        for number, command in enumerate(macro.commands, 1):
            if command.type not in set(MacroCommandType):
                yield f"{name_of(macro)}, command {number} is of type {command.type}, unknown to the document"
            elif command.type != MacroCommandType.DELAY and not 1 <= command.ratio <= 100:
                yield f"{name_of(macro)}, command {number} has the ratio {command.ratio}, outside 1..100"
    ending = dependency_order(MACRO.by_id(stored))
    if endless := [macro for macro in stored.macros if macro.macro_id not in ending]:
        yield f"{name_of(endless[0])} never ends: the macro runs itself or an endless macro"


def preflight_run(run: RecordRun, stored: Project, limits: MotionLimits, start: Mapping[int, int]) -> Iterator[str]:
    """Yield where a run of the records in `stored` exceeds `limits`, from the pose `start`, degrees by servo id."""
    for action in stored.actions:
        for _, text in _steps_beyond_limits(action, limits):
            yield f"{name_of(action)}, {text}"
    for move in run.moves(start):
        if exceeded := limits.exceeded_cap(move.step.servo_id, move.degrees, move.seconds):
            place = f"{move.path}: " if move.path else ""
            yield f"{place}{move}; its cap is {exceeded}"


def _beyond_limits(project: Project, limits: MotionLimits) -> Iterator[Diagnostic]:
    for at, action in enumerate(project.actions):
        for number, text in _steps_beyond_limits(action, limits):
            yield Diagnostic(f"actions[{at}].steps[{number}]", text, "warning")


def _steps_beyond_limits(action: Action, limits: MotionLimits) -> Iterator[tuple[int, str]]:
    """Yield the index of each step beyond the limits, with a text for people."""
    for at, step in enumerate(action.steps):
        if exceeded := limits.exceeded_angles(step.servo_id, step.degree):
            text = f"step {at + 1} asks servo {step.servo_id} to go to {step.degree} degrees; its limits are {exceeded}"
            yield at, text
