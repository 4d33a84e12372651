"""Forecast gate of a hub: tries motions on the twin of the robot before they are sent, and refuses falls."""

from __future__ import annotations

import asyncio
from collections.abc import Hashable, Mapping
from contextlib import aclosing, suppress
from typing import Any

from servolink.client import Board, servos_of
from servolink.errors import ServolinkError
from servolink.hub.engine.hub_gates import ForecastRefused
from servolink.hub.engine.motions import Motions
from servolink.hub.engine.questions import Questions
from servolink.hub.method_messages import QuestionAsk
from servolink.hub.rules.exchanges import Exchange
from servolink.hub.rules.tried import HubVerdict, MotionTwin, Pose, TriedMotions, TwinVerdict, Uncertain, is_near
from servolink.motion import Adc
from servolink.project import Project, RecordRun
from servolink.protocol import (
    ACTION,
    MACRO,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    Query,
    RecordType,
    SetServoParameterRequest,
)
from servolink.support import Tasks

LONGEST = 2.0
"""Seconds until a verdict: a program gives a request up after 3. The trial goes on, and its verdict is kept."""

_USUAL = 1.0  # seconds of a movement to which neither duration nor speed was given, and to a set-point
_ASKED = "; a page of the studio asks a person: send it again after the yes"
_UNASKED = "; a person can let it pass once, on a page of the studio"


class ForecastGate:
    """Gate that refuses motions with which the robot falls or hits itself, and asks a person about them."""

    def __init__(
        self, twin: MotionTwin, uncertain: Uncertain, board: Board, motions: Motions, questions: Questions
    ) -> None:
        """Try motions on `twin`, from where `motions` says that the servos of `board` are."""
        self._twin = twin
        self._uncertain = uncertain
        self._servos = servos_of(board)
        self._motions = motions
        self._questions = questions
        self._tried = TriedMotions()
        self._stored: dict[tuple[RecordType[Any], int], Project] = {}
        self._trials: dict[Hashable, tuple[Pose, asyncio.Task[TwinVerdict]]] = {}
        self._now = asyncio.get_running_loop().time
        self._tasks = Tasks()
        self._tasks.begin(self._warm())

    async def _warm(self) -> None:
        """Start the process of the twin, which takes a second or two."""
        with suppress(ServolinkError):
            await self._twin.check_move({}, {}, 1.0)

    async def close(self) -> None:
        """End all trials, and the process of the twin."""
        await self._tasks.close()
        await self._twin.close()

    async def refuse(self, exchange: Exchange, *, is_sent: bool = True) -> ForecastRefused | None:
        """Return the refusal of a motion, None if it may be sent. Stop, start and release of servos always may.

        Unless `is_sent`, the motion is sent later, and a person's yes still holds for it.
        """
        if isinstance(exchange.packet, SetServoParameterRequest):
            return None
        try:
            async with asyncio.timeout(LONGEST):
                found = await self._checked(exchange)
        except TimeoutError:
            found = HubVerdict("uncertain", f"it could not be tried within {LONGEST:g} s; send it again in a moment")
        except ServolinkError as error:
            found = HubVerdict("uncertain", str(error))
        session, motion = exchange.program.session_id, _motion(exchange)
        is_uncertain = found.verdict == "uncertain"
        must_stand = exchange.order is not None and exchange.order.must_stand
        may_pass = found.verdict == "stands" or (is_uncertain and self._uncertain == "pass" and not must_stand)
        if may_pass or self._tried.is_permitted(session, motion, self._now(), is_sent=is_sent):
            return None
        origins = ", ".join(f"{name} {origin}" for name, origin in found.basis.items())
        said = found.text + (f" ({origins})" if origins else "")
        text = f"nothing was moved: {'the forecast is uncertain' if is_uncertain else 'on the twin'}: {said}"
        if self._uncertain == "ask" and exchange.points is None and not must_stand:
            self._tasks.begin(self._ask(session, motion, exchange, said))
            text += _ASKED if self._questions.shown_by else _UNASKED
        return ForecastRefused(text, found.basis)

    async def prepare(self, packet: ExecuteActionExRequest | ExecuteMacroRequest) -> None:
        """Try a stored record in advance, so that its verdict is known when it is sent. What fails, fails then."""
        with suppress(TimeoutError, ServolinkError):
            async with asyncio.timeout(LONGEST):
                await self._record(packet)

    def sent(self, packet: Packet, outcome: object, asked_at: float, who: str, session_id: str) -> None:
        """Take a request that is over: what it has changed must be read again."""
        if not isinstance(packet, Query) and not packet.is_motion:
            self.forget(records=True)

    def left(self, session: str) -> None:
        """Forget a program that has left."""
        self._tried.left(session)

    def forget(self, *, records: bool) -> None:
        """Take back what persons have let pass, as after a stop; with `records`, read all records again."""
        self._tried.void_permits()
        if records:
            self._stored.clear()
            self._trials.clear()
            self._tried.forget_records()

    # --- verdicts -----------------------------------------------------------------------------------------------

    async def _checked(self, exchange: Exchange) -> TwinVerdict:
        """Return the verdict about a motion."""
        packet, order = exchange.packet, exchange.order
        if isinstance(packet, ExecuteActionExRequest | ExecuteMacroRequest):
            return await self._record(packet)
        if not isinstance(packet, ExecuteActionRequest):
            return HubVerdict("uncertain", f"a {type(packet).__name__} cannot be tried")
        steps = {step.servo_id: float(step.degree) for step in packet.steps}
        angles = steps if order is None else order.movement.targets
        is_raw = any(isinstance(each, Adc) for each in angles.values())
        if is_raw or any(exchange.program.units.of(each) != "degree" for each in angles):
            return HubVerdict("uncertain", "an angle in raw readings cannot be tried")
        targets = {each: float(angle) for each, angle in angles.items()}
        session, points = exchange.program.session_id, exchange.points
        if points is not None and self._tried.has_streamed(session, points, targets):
            return HubVerdict("stands", "")
        pose = await self._pose()
        seconds = _USUAL if points is not None else _seconds(exchange, pose, self._servos.planner.interval_unit)
        checked = await self._twin.check_move(pose, targets, seconds)
        if points is not None and checked.verdict == "stands":
            self._tried.add_point(session, points, targets)
        return checked

    async def _record(self, packet: ExecuteActionExRequest | ExecuteMacroRequest) -> TwinVerdict:
        """Return the verdict about a stored record, from the pose in which the robot is."""
        key = _key(packet)
        if key not in self._stored:
            self._stored[key] = await self._motions.stored(*key)
        pose = await self._pose()
        if (known := self._tried.verdict(key, pose)) is not None:
            return known
        tried, trial = self._trials.get(key, (None, None))
        if tried is None or trial is None or trial.done() or not is_near(tried, pose):
            trial = self._tasks.begin(self._try(key, self._stored[key], pose))
            self._trials[key] = pose, trial
        checked = await Tasks.shared_result(trial)
        if not is_near(pose, await self._pose()):
            return HubVerdict("uncertain", "the robot has moved since it was tried")
        return checked

    async def _try(self, key: tuple[RecordType[Any], int], project: Project, pose: Pose) -> TwinVerdict:
        """Try a record to the end, and keep the verdict unless the record may have changed meanwhile."""
        kind, record_id = key
        checked: TwinVerdict = HubVerdict("uncertain", "it was not tried")
        try:
            async with aclosing(self._twin.check_record(project, kind.by_id(project)[record_id], pose)) as pieces:
                async for piece in pieces:
                    if not isinstance(piece, bool):
                        checked = piece
        except ServolinkError as error:
            return HubVerdict("uncertain", str(error))
        if self._stored.get(key) is project:
            self._tried.add(key, pose, checked)
        return checked

    async def _pose(self) -> Pose:
        """Return where the servos are, in degrees; read if no course and no reading says so."""
        now = self._now()
        pose = self._motions.courses.pose(now)
        if not pose or not pose.keys() >= set(self._servos.all.known.ids):
            states = await self._servos.all.states()
            here = {each.servo_id: each.angle for each in states if self._servos.units.of(each.servo_id) == "degree"}
            self._motions.courses.seen(here, self._now())
            pose = {**here, **pose}
        return pose

    # --- a person -----------------------------------------------------------------------------------------------

    async def _ask(self, session: str, motion: Hashable, exchange: Exchange, warning: str) -> None:
        """Ask a person whether a motion may pass once."""
        asked = self._question(exchange, warning)
        with suppress(ServolinkError):  # nobody is there, nobody answers, or a stop comes first
            if (await self._questions.ask(session, asked, of_hub=True)).is_yes:
                self._tried.permit(session, motion, self._now())

    def _question(self, exchange: Exchange, warning: str) -> QuestionAsk:
        """Return the question about a motion."""
        packet, unit = exchange.packet, self._servos.planner.interval_unit
        if isinstance(packet, ExecuteActionExRequest | ExecuteMacroRequest):
            kind, record_id = key = _key(packet)
            caption, lasts = str(record_id), None
            if (project := self._stored.get(key)) is not None:
                record = kind.by_id(project)[record_id]
                caption, lasts = kind.caption_of(record) or caption, RecordRun(project, record, unit).known_seconds()
            is_action = isinstance(packet, ExecuteActionExRequest)
            return QuestionAsk(lasts or 0.0, {}, "action" if is_action else "macro", caption[:200], warning[:1000])
        assert isinstance(packet, ExecuteActionRequest), packet  # noqa: S101 - narrows the type
        order = exchange.order
        steps = {step.servo_id: float(step.degree) for step in packet.steps}
        targets = steps if order is None else order.movement.targets
        seconds = _seconds(exchange, self._motions.courses.pose(self._now()), unit)
        return QuestionAsk(
            seconds, {str(each): float(angle) for each, angle in targets.items()}, warning=warning[:1000]
        )


def _key(packet: ExecuteActionExRequest | ExecuteMacroRequest) -> tuple[RecordType[Any], int]:
    """Return type and id of the record that a packet runs."""
    match packet:
        case ExecuteActionExRequest(action_id):
            return ACTION, action_id
        case ExecuteMacroRequest(macro_id):
            return MACRO, macro_id


def _motion(exchange: Exchange) -> Hashable:
    """Return what makes a motion the same as another one."""
    if exchange.order is None:
        return exchange.packet
    movement = exchange.order.movement
    return tuple(sorted(movement.targets.items())), movement.duration, str(movement.speed)


def _seconds(exchange: Exchange, pose: Pose, interval_unit: float) -> float:
    """Return about how long a movement takes."""
    packet, order = exchange.packet, exchange.order
    if order is None:
        assert isinstance(packet, ExecuteActionRequest), packet  # noqa: S101 - narrows the type
        return max((step.interval for step in packet.steps), default=0) * interval_unit
    movement = order.movement
    if movement.duration is not None:
        return movement.duration
    speeds = movement.speed.values() if isinstance(movement.speed, Mapping) else (movement.speed or 0.0,)
    farthest = max((abs(angle - pose.get(each, 0.0)) for each, angle in movement.targets.items()), default=0.0)
    return farthest / min(speeds) if all(speeds) else _USUAL
