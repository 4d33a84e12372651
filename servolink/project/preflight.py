"""Find movements that are too fast or go too far, before a servo moves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from servolink.motion import AngleLimits, MotionLimits, SpeedCap, motion_limits
from servolink.project.model import Project
from servolink.project.records import with_dependencies
from servolink.project.validate import Diagnostic, too_fast
from servolink.protocol.record_types import ACTION, MACRO, Record


def preflight(
    project: Project,
    records: Iterable[Record] | None = None,
    *,
    speed_cap: SpeedCap | None = None,
    angle_limits: AngleLimits | None = None,
    start: Mapping[int, int] | None = None,
) -> list[Diagnostic]:
    """Return where `records` and all they run (None: everything) exceed `speed_cap` or `angle_limits`.

    `speed_cap` is in degrees per second, `angle_limits` in degrees, both for all servos or by servo id. `start` is the
    pose before the first movement, degrees by servo id; without it, first movements are not looked at. Raise
    ProjectError for an id that is used twice, and EncodeError for limits that allow nothing.
    """
    limits = motion_limits(angle_limits, speed_cap)
    found = list(_too_far(project, limits))
    if speed_cap is not None:
        found += too_fast(project, limits, start)
    if records is None:
        return found
    wanted = with_dependencies(project, records)
    places = {
        f"{kind.field}[{at}]"
        for kind in (ACTION, MACRO)
        for at, record in enumerate(getattr(project, kind.field))
        if record in wanted
    }
    return [one for one in found if one.path.partition(".")[0] in places]


def _too_far(project: Project, limits: MotionLimits) -> Iterator[Diagnostic]:
    for at, action in enumerate(project.actions):
        for number, step in enumerate(action.steps):
            if exceeded := limits.exceeded_angles(step.servo_id, step.degree):
                text = (
                    f"step {number + 1} asks servo {step.servo_id} to go to {step.degree} degrees; "
                    f"its limits are {exceeded}"
                )
                yield Diagnostic(f"actions[{at}].steps[{number}]", text, "warning")
