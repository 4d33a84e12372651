"""What is wrong with a project: what a board would refuse, and what it would do that nobody meant."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping

from servolink.project.checks.calling import wrong_calls
from servolink.project.checks.problem import Problem, Severity
from servolink.project.checks.repeats import number_of, repeats
from servolink.project.checks.speed import turns
from servolink.project.checks.storable import misfit, unstorable
from servolink.project.model import Project
from servolink.project.times import wrong_times
from servolink.protocol.joystick import Button
from servolink.protocol.servos import ALL_SERVOS, Step

_NUMBER = re.compile(r"\d+")
_PLACES = tuple(Project.__struct_fields__)


def problems(
    project: Project,
    *,
    servo_ids: Collection[int] | None = None,
    speed_cap: float | None = None,
    memory: int | None = None,
    start: Mapping[int, int] | None = None,
    caption_encoding: str = "utf-8",
) -> list[Problem]:
    """Return what is wrong with `project`, in the order of its file.

    Looked at as far as it is given: whether there are servos other than `servo_ids`; ways faster than `speed_cap`
    in degrees per second, with `start` as the pose (degrees by servo) before the first; whether all fits into
    `memory` bytes of a board, in whose `caption_encoding` captions are written.
    """
    if misfits := list(misfit("", project, exact=True)):
        return misfits  # values of other types, which no other check expects
    found = [*unstorable(project, caption_encoding, memory), *wrong_calls(project), *_twice(project)]
    found += _wrong_times(project)
    found += _unknown_servos(project, servo_ids)
    if speed_cap is not None:
        found += (
            Problem(turn.path, f"{turn}; its cap is {speed_cap:g}", "warning")
            for turn in turns(project, start)
            if turn.degrees_per_second > speed_cap
        )
    return sorted(found, key=_place)


def _wrong_times(project: Project) -> Iterator[Problem]:
    for at, number, takes in wrong_times(project):
        stated = project.macros[at].commands[number].total_interval
        given = f"is {stated}" if stated else "is not given"
        path = f"macros[{at}].commands[{number}].total_interval_ms"
        yield Problem(path, f"{given}; the command takes {takes} ms", "warning", fixable=True)


def _twice(project: Project) -> Iterator[Problem]:
    """Find servos with two steps in one action, and buttons that are twice in one table."""
    for at, action in enumerate(project.actions):
        yield from _repeated(f"actions[{at}].steps", action.steps)
    for at, table in enumerate(project.joystick_tables):
        yield from _repeated(f"joystick_tables[{at}].buttons", table.buttons)


def _repeated(place: str, parts: tuple[Step, ...] | tuple[Button, ...]) -> Iterator[Problem]:
    for at, before, same in repeats(parts):
        which = "with the same values" if same else "and boards differ in which they take"
        text = f"{number_of(parts[at])} is also in {place}[{before}], {which}"
        yield Problem(f"{place}[{at}].{parts[at].__struct_fields__[0]}", text, "warning", fixable=same)


def _unknown_servos(project: Project, servo_ids: Collection[int] | None) -> Iterator[Problem]:
    """Find what is for servos that are not there: boards refuse their parameters, and pass over their steps."""
    places = [(f"servo_parameters[{at}]", one.servo_id) for at, one in enumerate(project.servo_parameters)]
    for at, action in enumerate(project.actions):
        places += [(f"actions[{at}].steps[{number}]", step.servo_id) for number, step in enumerate(action.steps)]
    for path, servo_id in places:
        severity: Severity = "warning" if "steps" in path else "error"
        if servo_id == ALL_SERVOS:
            yield Problem(f"{path}.servo_id", f"{ALL_SERVOS} means all servos and is none", severity)
        elif servo_ids is not None and servo_id not in servo_ids:
            yield Problem(f"{path}.servo_id", f"there is no servo {servo_id}", severity)


def _place(problem: Problem) -> tuple[int, list[int]]:
    """Return what sorts problems as a file does."""
    name = problem.path.partition("[")[0].partition(".")[0]
    return _PLACES.index(name) if name in _PLACES else -1, [int(number) for number in _NUMBER.findall(problem.path)]
