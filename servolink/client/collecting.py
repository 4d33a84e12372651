"""Reading of stored records together with everything they run."""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from typing import Any, TypeAlias

from servolink.client.servo_state import Servo
from servolink.errors import MotionRefused, NotFound, RequestRefused
from servolink.project import Project, RecordRun, name_of, uncheckable
from servolink.protocol import ACTION, MACRO, Action, Macro, RecordType

_MOST = ACTION.list_limit + MACRO.list_limit  # bound of all lists of records

Get: TypeAlias = Callable[[RecordType[Any], int], Awaitable[Any]]
"""Returns a record by type and id. Raises NotFound if there is none."""


async def collect(get: Get, kind: RecordType[Any], record_id: int) -> Project:
    """Read an action or a macro with all records run by it.

    Raise NotFound if the board does not return one of them, MotionRefused if they are too many or nested too deep.
    """
    record = await get(kind, record_id)
    found: dict[tuple[RecordType[Any], int], Any] = {(kind, record_id): record}
    waiting = deque([(record, 0)])
    while waiting:
        caller, depth = waiting.popleft()
        for called in RecordType.of(caller).references(caller):
            if called in found:
                continue
            if depth == Macro.MAX_NESTING or len(found) == _MOST:
                many = f"it runs {len(found):,} records, in macros up to {depth + 1} deep"
                raise MotionRefused(
                    f"{name_of(record)} was not run: {many}; at most {_MOST:,} and {Macro.MAX_NESTING} are read first"
                )
            try:
                found[called] = await get(*called)
            except NotFound as error:
                missing = f"{name_of(caller)} runs {called[0]} {called[1]}, which could not be read"
                raise NotFound(f"{name_of(record)} was not run: {missing}", error.request) from error
            waiting.append((found[called], depth + 1))
    return Project(
        actions=tuple(one for one in found.values() if isinstance(one, Action)),
        macros=tuple(one for one in found.values() if isinstance(one, Macro)),
    )


def check_can_wait(run: RecordRun, servos: Iterable[Servo]) -> None:
    """Raise RequestRefused for an endless run, NotFound for a run of missing servos."""
    name = name_of(run.record)
    if why := next(uncheckable(run.stored), ""):
        raise RequestRefused(f"{name} was not run, because its end could not be known: {why}")
    present = {servo.servo_id for servo in servos}
    if missing := sorted(servo_id for servo_id in run.last_pose() if servo_id not in present):
        raise NotFound(f"{name} was not run: it moves servo {missing[0]}, which the board does not have")
