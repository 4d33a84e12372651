"""Playing: an action or a macro of a project on a board, step by step, without storing."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Generator
from typing import Any

from msgspec.structs import replace

from servolink.client.board_servos import ServoController
from servolink.client.projects import check_project
from servolink.client.session import Session
from servolink.client.stored_runs import StoredRuns, check_can_wait, collect
from servolink.connection import UnitsChanged
from servolink.errors import ConnectionLost, EncodeError, NotFound, Reason, RequestRefused
from servolink.motion import INTERVAL_UNIT, Ticket
from servolink.project import Project, RecordRun, name_of, with_caption
from servolink.protocol import (
    ACTION,
    MACRO,
    Action,
    ExecuteActionRequest,
    MacroCommandType,
    MacroPlaying,
    RecordType,
    Step,
)

_LOOK_EVERY = 0.04  # seconds between two looks for a pause, a stop or a loss


class Playback:
    """Pause, continuation and progress of `Board.play`. Safe for use from any thread."""

    def __init__(self) -> None:
        self.is_paused = False
        """Whether no further step begins; servos still finish a begun step."""
        self.seconds = 0.0
        """How much was played, without pauses and without the movement to the first pose."""
        self.total_seconds = 0.0
        """Duration of the whole run; 0 before the check."""

    def pause(self) -> None:
        """Begin no further step. The servos finish begun steps, and are then held."""
        self.is_paused = True

    def resume(self) -> None:
        """Continue with the next step."""
        self.is_paused = False


class Playing:
    """Plays actions and macros of projects, within the limits of movements."""

    def __init__(self, session: Session, servos: ServoController, runs: StoredRuns) -> None:
        """Check with `runs` as for stored records."""
        self._session = session
        self._servos = servos
        self._runs = runs
        self._interval_unit = servos.planner.interval_unit

    async def play(
        self,
        project: Project,
        name: int | str,
        *,
        playback: Playback | None = None,
        dry_run: bool = False,
        start: bool = False,
        any_angle: bool = False,
    ) -> float:
        """Play a record and return its duration in seconds (see `Board.play`)."""
        check_project(project)
        ticket = self._session.ticket()
        project.by_type()  # refuses a repeated id: either record could be meant
        record = project.find(str(name), (ACTION, MACRO))
        stored = await collect(_reader(project), RecordType.of(record), RecordType.of(record).id_of(record))

        async def read() -> RecordRun:
            try:
                return await self._playable(stored, record, start=start, any_angle=any_angle)
            except RequestRefused:
                self._runs.check_is_current(name_of(record), ticket)  # a stop since is the better reason
                raise

        if start and not dry_run:  # no servo is started for a refused run
            run, _ = await self._runs.prepare(read, ticket, wait=True, dry_run=True, any_angle=any_angle)
            for servo_id in await self._servos.all.ready(run.servo_ids(), start=True):
                await self._servos.set_servo(servo_id, start=True, hold=True, ticket=ticket)
        run, ticket = await self._runs.prepare(read, ticket, wait=True, dry_run=dry_run, any_angle=any_angle)
        if dry_run:
            return run.seconds()
        playback = playback or Playback()
        playback.total_seconds = run.seconds()
        player = _ProjectPlayer(self._session, run, self._interval_unit, ticket, playback)
        try:
            await player.play()
            await self._runs.until_at_rest(run, player.latest, ticket)
        except ConnectionLost as error:
            raise player.lost(error) from error
        return run.seconds()

    async def _playable(self, stored: Project, record: Any, *, start: bool, any_angle: bool) -> RecordRun:
        """Return the run of a record. Raise EncodeError or RequestRefused for an unplayable or endless run."""
        for one in (*stored.actions, *stored.macros):
            self._check_values(one)
        run = RecordRun(stored, record, self._interval_unit)
        for action in stored.actions:
            angles = {step.servo_id: step.degree for step in action.steps}
            self._servos.planner.check_turns(angles, self._servos.units.of, any_angle=any_angle)
        servos = await self._servos.servos()
        await self._servos.all.ready(run.servo_ids(), start=start)
        check_can_wait(run, servos)  # endless runs were refused above
        for action, speed in run.slowest():
            try:
                self._session.codec.encode(_movement(action.steps, speed))
            except EncodeError as error:
                raise EncodeError(f"{name_of(action)} at {speed:.3g} times its speed: {error.text}") from error
        why = f"{name_of(record)} was not played:"
        used = [servo for servo in servos if servo.servo_id in run.servo_ids()]
        for servo in used:
            if self._servos.units.of(servo.servo_id) == "adc":
                text = f"{why} servo {servo.servo_id} is set to raw ADC; set its angle unit to degrees"
                raise RequestRefused(text, reason=Reason.ANGLE_UNIT)
        return run

    def _check_values(self, record: Any) -> None:
        """Raise EncodeError for values out of range; the caption is not sent."""
        kind: RecordType[Any] = RecordType.of(record)
        try:
            self._session.codec.encode(kind.add(with_caption(record, "")))
        except EncodeError as error:
            raise EncodeError(f"{name_of(record)}, {error.path}: {error.text}") from error
        for number, command in enumerate(record.commands if kind is MACRO else (), 1):
            if command.type == MacroCommandType.DELAY and command.command_id < 0:
                raise EncodeError(f"{name_of(record)}, command {number} is a delay of {command.command_id} ms")


class _ProjectPlayer:
    """Sender of the steps of a run, each at its time."""

    def __init__(  # all are needed for each step
        self,
        session: Session,
        run: RecordRun,
        interval_unit: float,
        ticket: Ticket,
        playback: Playback,
    ) -> None:
        self._session = session
        self._run = run
        self._unit = interval_unit
        self._connection = session.connection
        self._ticket = ticket
        self._playback = playback
        self._waiting: list[ExecuteActionRequest] = []
        """Movements to begin at the present time."""
        self._due = asyncio.get_running_loop().time()
        """Time of the next step, seconds of the event loop's clock."""
        self.latest = ExecuteActionRequest()
        """Latest movement sent to the board."""
        self._has_begun = False

    def lost(self, error: ConnectionLost) -> ConnectionLost:
        """Return the error of a run whose connection was lost, with the first cause."""
        cause = self._connection.ended or error
        if self._has_begun:
            lost = "the connection was lost before it was over"
            return ConnectionLost(f"{name_of(self._run.record)} was started, and {lost}: {cause}")
        return ConnectionLost(f"{name_of(self._run.record)} was not started: {cause}")

    async def play(self) -> None:
        """Send all steps, and return after the time of the last."""
        for seconds in self._pauses():
            await self._wait_until_resumed()
            shortest = 0.0
            for movement in self._waiting:
                await self._send(movement)
                shortest = self._unit  # repeats of an action without duration must not fill the line
            self._waiting.clear()
            await self._wait(max(seconds, shortest))

    def _pauses(self) -> Generator[float, None, object]:
        record, stored = self._run.record, self._run.stored
        if not isinstance(record, Action):
            slowness = self._unit / INTERVAL_UNIT
            playing = MacroPlaying(ACTION.by_id(stored), MACRO.by_id(stored), self._move, slowness)
            return playing.play(record.macro_id)
        self._move(record.steps, 1.0)
        return (seconds for seconds in (self._run.seconds(),))

    def _move(self, steps: tuple[Step, ...], speed: float) -> None:
        if steps:
            self._waiting.append(_movement(steps, speed))

    async def _send(self, movement: ExecuteActionRequest) -> None:
        """Send a movement, once. Raise RequestRefused after a stop or a new unit, ConnectionLost after a loss."""
        self._check()
        self._has_begun, self.latest = True, movement
        try:
            await self._connection.send(movement, ticket=self._ticket)
        except UnitsChanged:
            text = f"{name_of(self._run.record)} was ended, because an angle unit was set while it was played"
            raise RequestRefused(text, movement, reason=Reason.ANGLE_UNIT) from None
        # A late step is not cut short: the next would turn faster than checked.
        self._due = max(self._due, asyncio.get_running_loop().time())

    async def _wait(self, seconds: float) -> None:
        """Wait until `seconds` after the latest due time, with checks for stops, losses and progress."""
        loop = asyncio.get_running_loop()
        before, self._due = self._playback.seconds, self._due + seconds
        while (remaining := self._due - loop.time()) > 0:
            self._playback.seconds = before + max(seconds - remaining, 0.0)
            await asyncio.sleep(min(remaining, _LOOK_EVERY))
            self._check()
        self._playback.seconds = before + seconds
        if seconds <= 0:
            await asyncio.sleep(0)  # a macro can have billions of commands without duration
            self._check()

    async def _wait_until_resumed(self) -> None:
        loop = asyncio.get_running_loop()
        while self._playback.is_paused:
            await asyncio.sleep(_LOOK_EVERY)
            self._check()
            self._due = max(self._due, loop.time())

    def _check(self) -> None:
        self._session.check_goes_on(name_of(self._run.record), self.latest, self._ticket)


def _movement(steps: tuple[Step, ...], speed: float) -> ExecuteActionRequest:
    """Return the movement to start the steps of an action, at a speed of 1 or less."""
    return ExecuteActionRequest(
        tuple(
            # Rounded first, as 7 / 0.7 is a little more than 10.
            replace(step, interval=max(1, math.ceil(round(step.interval / speed, 6))))
            for step in steps
        )
    )


def _reader(project: Project) -> Any:
    """Return a function for `collect` that returns records of `project`."""

    async def get(kind: RecordType[Any], number: int) -> Any:
        try:
            return kind.by_id(project)[number]
        except KeyError:
            raise NotFound(f"the project has no {kind} {number}") from None

    return get
