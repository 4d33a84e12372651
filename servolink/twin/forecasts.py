"""Forecast: whether a robot stands in its actions and macros, over the values of the body that nobody knows exactly."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from enum import StrEnum
from itertools import product
from typing import Any, Final, NamedTuple

import msgspec
from msgspec import Struct

from servolink.errors import TwinError
from servolink.project import Project
from servolink.protocol import Action, Macro, RecordType
from servolink.twin.body import Body
from servolink.twin.picture import draw
from servolink.twin.simulation import STEP, Physics
from servolink.twin.trial import AS_WRITTEN, LONGEST, Collision, Fall, TrialResult, Variation, run_seconds, run_trial

SPREAD: Final = 0.2
"""Share by which the values of a body vary in a forecast, up and down."""
VARIATIONS: Final = (
    AS_WRITTEN,
    *(Variation(*factors) for factors in product((1 - SPREAD, 1 + SPREAD), repeat=3)),
)
"""The body as written, and each combination of the lowest and highest mass, stiffness and friction."""

_WORTH_PROCESSES = 100.0  # simulated seconds; for less, starting processes takes longer than they save


class _Task(NamedTuple):
    record: Action | Macro
    seconds: float
    variation: Variation


class Verdict(StrEnum):
    """Result of a forecast."""

    STANDS = "stands"
    """The robot stands with all variations."""
    FALLS = "falls"
    """The robot falls with all variations."""
    UNCERTAIN = "uncertain"
    """The robot falls with some variations."""


class Forecast(Struct, frozen=True):
    """Forecast for one action or macro."""

    record: Action | Macro
    verdict: Verdict
    seconds: float
    """Duration of the run, in seconds."""
    trials: tuple[TrialResult, ...]
    """Trials in the order of `VARIATIONS`."""

    @property
    def fall(self) -> Fall | None:
        """Fall of the body as written, or else the earliest of another variation."""
        falls = [trial.fall for trial in self.trials if trial.fall is not None]
        return self.trials[0].fall or min(falls, key=lambda fall: fall.seconds, default=None)

    def picture(self, project: Project, body: Body) -> bytes:
        """Return a PNG picture of the robot at `moment`. Raise TwinError if nothing can be drawn."""
        return draw(project, body, self.record, *self.moment)

    @property
    def worst_tilt(self) -> float:
        """Largest lean of the body as written, in degrees."""
        return self.trials[0].worst_tilt

    @property
    def margin_mm(self) -> float | None:
        """Least margin of the centre of mass over all trials without a fall; None without such a trial."""
        margins = [one.margin_mm for one in self.trials if one.fall is None and one.margin_mm is not None]
        return min(margins, default=None)

    @property
    def collisions(self) -> tuple[Collision, ...]:
        """Collisions of the body as written."""
        return self.trials[0].collisions

    @property
    def torque(self) -> dict[int, float]:
        """Highest torque of each servo over all trials, as a share of its strongest."""
        return _highest(trial.torque for trial in self.trials)

    @property
    def lag(self) -> dict[int, float]:
        """Largest lag of each servo over all trials, in degrees."""
        return _highest(trial.lag for trial in self.trials)

    @property
    def is_whole(self) -> bool:
        """Whether the run was tried to its end, and not cut off after `LONGEST` seconds."""
        return self.seconds <= LONGEST

    def as_dict(self) -> dict[str, Any]:
        """Return the forecast for JSON, with the type, id and caption of the record."""
        kind = RecordType.of(self.record)
        return {
            "type": kind.label,
            "id": kind.id_of(self.record),
            "caption": kind.caption_of(self.record),
            "verdict": self.verdict,
            "seconds": self.seconds,
            "is_whole": self.is_whole,
            "fall": msgspec.to_builtins(self.fall),
            "worst_tilt": self.worst_tilt,
            "margin_mm": self.margin_mm,
            "collisions": msgspec.to_builtins(self.collisions),
            "torque": self.torque,
            "lag": self.lag,
        }

    @property
    def moment(self) -> tuple[Variation, float]:
        """Variation and time of the fall, or of the largest lean of the body as written."""
        if (fall := self.fall) is not None:
            return fall.variation, fall.seconds
        return AS_WRITTEN, self.trials[0].worst_at


def _highest(values: Iterable[dict[int, float]]) -> dict[int, float]:
    highest: dict[int, float] = {}
    for each in values:
        for servo_id, value in each.items():
            highest[servo_id] = max(value, highest.get(servo_id, value))
    return highest


def forecast(
    project: Project, body: Body, records: Iterable[Action | Macro], *, processes: int = 1, step: float = STEP
) -> list[Forecast]:
    """Return a forecast for each record, run from the pose with all servos at 0.

    Args:
        project: Project with the records, and all records run by them.
        body: Body of the robot.
        records: Actions and macros to try.
        processes: Most processes at work. Above 1, the main module of the program must be safe to import.
        step: Seconds of a step of the physics; a tick of the simulation has a whole number of steps.

    Raises:
        ProjectError: No board could play one of the macros.
        TwinError: MuJoCo is missing, parts of the body overlap, or a process was ended from outside.
    """
    runs = [(record, run_seconds(project, record)) for record in records]
    tasks = [_Task(record, seconds, variation) for record, seconds in runs for variation in VARIATIONS]
    physics = Physics(body, step)
    if processes > 1 and sum(min(task.seconds, LONGEST) for task in tasks) > _WORTH_PROCESSES:
        trials = _run_in_processes(project, body, step, tasks, processes)
    else:
        trials = [run_trial(physics, project, task.record, task.variation, task.seconds) for task in tasks]
    count = len(VARIATIONS)
    return [
        _forecast(record, seconds, tuple(trials[at * count : (at + 1) * count]))
        for at, (record, seconds) in enumerate(runs)
    ]


def _forecast(record: Action | Macro, seconds: float, trials: tuple[TrialResult, ...]) -> Forecast:
    falls = [trial.fall is not None for trial in trials]
    verdict = Verdict.FALLS if all(falls) else Verdict.UNCERTAIN if any(falls) else Verdict.STANDS
    return Forecast(record, verdict, seconds, trials)


def _run_in_processes(
    project: Project, body: Body, step: float, tasks: list[_Task], processes: int
) -> list[TrialResult]:
    others = set(multiprocessing.active_children())
    # A fork would copy the threads of the program half-way through their work.
    executor = ProcessPoolExecutor(
        processes, multiprocessing.get_context("spawn"), _begin_process, (project, body, step)
    )
    try:
        longest_first = sorted(range(len(tasks)), key=lambda at: -tasks[at].seconds)
        futures = {at: executor.submit(_run_task, tasks[at]) for at in longest_first}
        return [futures[at].result() for at in range(len(tasks))]
    except BrokenProcessPool as error:
        raise TwinError("a process of the forecast was ended from outside; try again, with fewer processes") from error
    except BaseException:
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        executor.shutdown(cancel_futures=True)


_in_process: list[tuple[Physics, Project]] = []


def _begin_process(project: Project, body: Body, step: float) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the program ends its processes
    _in_process.append((Physics(body, step), project))


def _run_task(task: _Task) -> TrialResult:
    physics, project = _in_process[-1]
    return run_trial(physics, project, task.record, task.variation, task.seconds)
