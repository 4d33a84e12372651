"""Motions: sending of motions within the limits of the board, and their end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

from servolink.client import Board, collect, servos_of, with_ticket
from servolink.errors import (
    EncodeError,
    OutcomeUnknown,
    RequestError,
    RequestTimeout,
    ServolinkError,
    TargetNotReached,
)
from servolink.hub.engine.hub_gates import refused_response
from servolink.hub.rules.courses import Courses
from servolink.hub.rules.exchanges import Exchange, MoveOrder, RunEnd
from servolink.motion import INTERVAL_UNIT, SetPoints, Ticket
from servolink.project import Project, RecordRun
from servolink.protocol import (
    ACTION,
    MACRO,
    Command,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroPlaying,
    Packet,
    RecordType,
    Request,
    Response,
    SetServoParameterRequest,
    Step,
)
from servolink.support import computed

_PAUSE = 0.5  # seconds between two readings of servos that may move
_RESTING = 4  # readings in a row between which no servo turns
_JITTER = {"degree": 1, "adc": 12, None: 1}  # by how much the reading of a resting servo may differ


class Outcome(NamedTuple):
    """Outcome of a motion."""

    response: Response | None
    """Response for the program; None without a response."""
    refusal: ServolinkError | None = None
    """Reason for not sending the motion; None after sending."""


class Motions:
    """Sender of motions that uses the methods of `Board`, so that limits hold by the same code for every program."""

    def __init__(self, board: Board) -> None:
        """Send to `board`, set to the units of the program whenever a motion is sent."""
        self.courses = Courses()
        """Angles that the servos should have, by what was sent."""
        self._board = board
        self._servos = servos_of(board)

    async def send(self, packet: Packet, ticket: Ticket | None = None, *, unchecked: bool = True) -> Outcome:
        """Send a motion within the limits of the board; refuse a motion that limits cannot be compared with.

        With limits, a stored record and all that it runs is read and checked first, and a soft start takes seconds.
        Whatever is sent has `ticket`, which the gates of the connection look at. Raise RequestTimeout or OutcomeUnknown
        if the board does not answer.
        """
        try:
            outcome = Outcome(await self._response_to(packet, ticket, unchecked=unchecked))
        except (RequestTimeout, OutcomeUnknown):
            raise
        except (EncodeError, RequestError, TargetNotReached) as error:  # the last one: at the end of a soft start
            return Outcome(await self.refused(packet), error)
        self._sent(packet)
        return outcome

    async def _response_to(self, packet: Packet, ticket: Ticket | None, *, unchecked: bool) -> Response | None:
        """Send a motion, and return the response of the board."""
        if isinstance(packet, SetServoParameterRequest):
            return await self._servos.answer_to(packet, ticket=ticket, unchecked=unchecked)
        if isinstance(packet, ExecuteActionRequest) and not self._board.limits:
            # Without limits, the board decides about a movement that names a servo twice.
            await self._servos.send(packet, ticket=ticket)
            return None
        board = self._board if ticket is None else with_ticket(self._board, ticket)
        if isinstance(packet, Request):
            response: Response = await board.request(packet, unchecked=unchecked)
            return response
        assert isinstance(packet, Command), packet  # noqa: S101 - narrows the type
        await board.send(packet)
        return None

    async def move(self, exchange: Exchange, order: MoveOrder, ticket: Ticket) -> Outcome:
        """Plan a movement for the units set now, and send it. Raise OutcomeUnknown for a start that is not answered."""
        try:
            plan = await self._servos.move(order.movement, ticket, start=order.start, planner=order.planner)
        except OutcomeUnknown:
            raise
        except (EncodeError, RequestError) as error:
            return Outcome(None, error)
        exchange.plan, exchange.packet = plan, plan.packet
        self._sent(plan.packet)
        return Outcome(None)

    async def stream(self, packet: Packet, points: SetPoints, ticket: Ticket) -> Outcome:
        """Send a movement toward the set-points in `packet`, shortened by `points` and not refused for a limit."""
        assert isinstance(packet, ExecuteActionRequest), packet  # noqa: S101 - narrows the type
        targets = {step.servo_id: step.degree for step in packet.steps}
        try:
            await self._servos.stream(targets, points, ticket)
        except (EncodeError, RequestError) as error:
            return Outcome(None, error)
        self._sent(ExecuteActionRequest(points.latest))
        return Outcome(None)

    async def refused(self, packet: Packet) -> Response | None:
        """Return the response to a packet that was not sent; the state of servos is read for the response."""
        if not isinstance(packet, SetServoParameterRequest):
            return refused_response(packet)
        try:
            states = await self._servos.all.states(packet.servo_id)
        except ServolinkError:
            return None
        return refused_response(packet, states)

    async def end_of(self, packet: Packet) -> RunEnd | None:
        """Return the end of a motion; None if it is unknown."""
        match packet:
            case ExecuteActionRequest():
                return RunEnd(self.seconds_of_steps(packet), {step.servo_id: step.degree for step in packet.steps})
            case ExecuteActionExRequest():
                return await self._end_of(ACTION, packet.action_id)
            case ExecuteMacroRequest():
                return await self._end_of(MACRO, packet.macro_id)
            case _:  # a started servo may turn to an old target, a released one falls
                return None

    def expect(self, end: RunEnd, ends_at: float, changes: int) -> None:
        """Expect the end of a stored run at `ends_at`, on the clock of the event loop.

        The servos are in its last pose then, unless courses have changed since `changes`.
        """
        is_latest, units = changes == self.courses.changes, self._servos.units.of
        self.courses.end(end.pose if is_latest else {}, ends_at, units)
        if is_latest and end.play is not None:
            self.courses.play(end.play, ends_at - end.seconds, units, self._servos.planner.interval_unit)

    def seconds_of_steps(self, packet: ExecuteActionRequest) -> float:
        """Return how long a movement takes."""
        return self._servos.planner.seconds_of(packet.steps)

    async def until_rest(self) -> None:
        """Return when no servo has turned for 1.5 s. A board without answers gives no state: continue asking."""
        first, count = dict[int, int](), 0
        while count < _RESTING:
            await asyncio.sleep(_PAUSE)
            try:
                states = await self._servos.all.states()
            except ServolinkError:
                count = 0
                continue
            here = {state.servo_id: state.angle for state in states}  # other numbers also after a change of units
            if count and self._is_same(first, here):
                count += 1
            else:
                first, count = here, 1

    def _sent(self, packet: Packet) -> None:
        now = asyncio.get_running_loop().time()
        self.courses.sent(packet, now, self._servos.units.of, self._servos.planner.interval_unit)

    async def stored(self, kind: RecordType[Any], record_id: int) -> Project:
        """Read a stored action or macro with all records run by it. Raise as `servolink.client.collect`."""
        return await collect(self._get, kind, record_id)

    async def _end_of(self, kind: RecordType[Any], record_id: int) -> RunEnd | None:
        try:
            stored = await self.stored(kind, record_id)
        except ServolinkError:
            return None
        interval_unit = self._servos.planner.interval_unit

        def play(move: Callable[[tuple[Step, ...], float], None]) -> Generator[float, None, object]:
            if kind is MACRO:
                slowness = interval_unit / INTERVAL_UNIT
                yield from MacroPlaying(ACTION.by_id(stored), MACRO.by_id(stored), move, slowness).play(record_id)
                return None
            move(ACTION.by_id(stored)[record_id].steps, 1.0)
            return None

        def end() -> RunEnd | None:
            run = RecordRun(stored, kind.by_id(stored)[record_id], interval_unit)
            seconds = run.known_seconds()
            return None if seconds is None else RunEnd(seconds, run.last_pose(), play)

        return await computed(end)()

    async def _get(self, kind: RecordType[Any], record_id: int) -> Any:
        return await (self._board.action(record_id) if kind is ACTION else self._board.macro(record_id))

    def _is_same(self, first: dict[int, int], here: dict[int, int]) -> bool:
        """Return whether the same servos rest, within the noise of their sensors."""
        return first.keys() == here.keys() and all(
            abs(first[servo_id] - here[servo_id]) <= _JITTER[self._servos.units.of(servo_id)] for servo_id in first
        )
