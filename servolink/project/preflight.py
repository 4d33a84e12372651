"""What a movement asks for that it should not, before anything moves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from servolink.motion import AngleLimits
from servolink.project.model import Project
from servolink.project.records import by_kind
from servolink.project.speed import servo_moves
from servolink.project.validate import Diagnostic
from servolink.protocol.record_types import ACTION, MACRO, Record, type_of


def preflight(
    project: Project,
    records: Iterable[Record] | None = None,
    *,
    speed_cap: float | None = None,
    angle_limits: AngleLimits | None = None,
    start: Mapping[int, int] | None = None,
) -> list[Diagnostic]:
    """Return where `records` and what they call (None: everything) are too fast or go too far.

    Looked at as far as it is given: ways faster than `speed_cap` in degrees per second, with `start` as the pose
    (degrees by servo) before the first; angles outside `angle_limits`. ProjectError for ids that are used twice.
    """
    found: list[Diagnostic] = []
    if angle_limits is not None:
        found += _too_far(project, angle_limits)
    if speed_cap is not None:
        found += [
            Diagnostic(turn.path, f"{turn}; its cap is {speed_cap:g}", "warning")
            for turn in servo_moves(project, start)
            if turn.degrees_per_second > speed_cap
        ]
    if records is None:
        return found
    places = _places(project, records)
    return [one for one in found if one.path.partition(".")[0] in places]


def _too_far(project: Project, limits: AngleLimits) -> Iterator[Diagnostic]:
    for at, action in enumerate(project.actions):
        for number, step in enumerate(action.steps):
            allowed = limits if isinstance(limits, tuple) else limits.get(step.servo_id)
            if allowed is not None and not allowed[0] <= step.degree <= allowed[1]:
                text = (
                    f"step {number + 1} asks servo {step.servo_id} to go to {step.degree} degrees; "
                    f"its limits are {allowed[0]:g}..{allowed[1]:g}"
                )
                yield Diagnostic(f"actions[{at}].steps[{number}]", text, "warning")


def _places(project: Project, records: Iterable[Record]) -> set[str]:
    """Return where in the project `records` are, and all that they call."""
    shelves = by_kind(project)
    paths = {
        (plural, record_id): f"{plural}[{at}]"
        for plural, shelf in shelves.items()
        for at, record_id in enumerate(shelf)
    }
    found = set[str]()
    waiting = [(ACTION if isinstance(one, ACTION.record_class) else MACRO, one) for one in records]
    while waiting:
        kind, record = waiting.pop()
        path = paths[kind.field, kind.id_of(record)]
        if path not in found:
            found.add(path)
            waiting += [
                (other, shelves[other.field][called])
                for other, called in type_of(record).references(record)
                if called in shelves[other.field]
            ]
    return found
