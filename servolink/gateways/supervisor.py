"""Supervisor: motions of a model or another program, allowed one by one by a person.

Role, limits, lease and dead man's switch are those of the hub. On top of these, a permission is for one motion, lasts
10 s and ends with a stop, and no motion lasts longer than 10 s.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any, Final, NamedTuple

import msgspec
from msgspec import Raw

from servolink.client import Board, collect, connect, servo_targets
from servolink.control import Answer, Greeting, RoleName, RpcChannel, StoppedNotice, Tighten, open_channel, this_program
from servolink.errors import MotionRefused, Reason, RequestRefused, ServolinkError, escape
from servolink.motion import INTERVAL_UNIT, StopCounter, Ticket
from servolink.project import RecordRun, name_of
from servolink.protocol import ACTION, ALL_SERVOS, RecordType

LONGEST: Final = 10.0
"""Longest motion in seconds, with the time for sending."""
PERMITTED: Final = 10.0
"""Seconds from a permission until the motion must have begun."""
OPEN: Final = 60.0
"""Seconds in which a question must be answered."""

_FOR_THE_LINE = 0.5  # seconds of `LONGEST` that a motion leaves for sending
_DEAD_MAN = 3.0  # seconds
_BEAT = 0.5  # seconds between two beats of the dead man's switch
_LIMIT = 5.0  # seconds for immediate answers of the hub


class SupervisedMotion(NamedTuple):
    """Checked motion: a method of the control interface, with its params."""

    method: str
    params: dict[str, Any]
    text: str
    """Motion as a person reads it, such as "move servo 1 to 30 degrees in 2 s"."""
    seconds: float
    """Planned duration of the motion, as the dry run has found it."""
    caption: str = ""
    """Caption of the stored record that is run, or its id; empty for other motions."""


class Permission(NamedTuple):
    """Permission of a person for one motion."""

    motion: SupervisedMotion
    ticket: Ticket
    """Ticket from the moment of the request: a later stop voids the permission."""


class Question(NamedTuple):
    """Question to a person whether a motion may begin."""

    motion: SupervisedMotion
    ticket: Ticket
    """Ticket from the moment of the request: a later stop voids the question."""
    number: int
    """Random, so that no other client can answer the question."""

    @property
    def text(self) -> str:
        """Question as a person reads it."""
        return f"May the robot {self.motion.text}? The motion lasts {self.motion.seconds:.1f} s."


class Supervisor:
    """Program of a hub for motions, which are checked, and carried out if allowed."""

    def __init__(
        self, hub: str, board: Board, channel: RpcChannel, *, may_move: bool, log: Callable[[str], None]
    ) -> None:
        """Use `supervised`."""
        self.hub = hub
        """Name of the hub that shares the board."""
        self.board = board
        """Board to read and to check motions; the hub refuses all changes by this board."""
        self.may_move = may_move
        self._channel = channel
        self._log = log
        self._now = asyncio.get_running_loop().time
        self._stops = StopCounter()
        self._stopped = asyncio.Event()
        self._question: Question | None = None
        self._is_moving = False
        channel.on_notification = self._hear
        channel.on_end = lambda: self._stop("the hub has ended")

    async def check_move(
        self, targets: Mapping[str, float], duration: float | None, speed: float | None
    ) -> SupervisedMotion:
        """Return a movement to angles in degrees. Raise MotionRefused for one beyond the limits, or without effect."""
        by_id = await servo_targets(self.board, targets)
        await self._refuse_idle(by_id)
        seconds = await self.board.move(dict(targets), duration=duration, speed=speed, dry_run=True)
        angles = ", ".join(f"{escape(servo)} to {angle:g} degrees" for servo, angle in targets.items())
        params = {"targets": {str(servo_id): angle for servo_id, angle in by_id.items()}, "duration": seconds}
        return _checked(SupervisedMotion("move", params, f"move servo {angles}", seconds))

    async def check_run(self, kind: RecordType[Any], name: int | str) -> SupervisedMotion:
        """Return the run of a stored action or macro. Raise MotionRefused as `check_move` does."""
        board = self.board
        record = await (board.action(name) if kind is ACTION else board.macro(name))
        record_id = kind.id_of(record)
        await (
            board.run_action(record_id, dry_run=True) if kind is ACTION else board.run_macro(record_id, dry_run=True)
        )

        async def get(kind: RecordType[Any], record_id: int) -> Any:
            return await (board.action(record_id) if kind is ACTION else board.macro(record_id))

        interval = board.profile and board.profile.settings.interval_unit
        run = RecordRun(await collect(get, kind, record_id), record, interval or INTERVAL_UNIT)
        await self._refuse_idle(run.first_pose())
        params = {"type": "action" if kind is ACTION else "macro", "id": record_id}
        caption = kind.caption_of(record) or str(record_id)
        return _checked(SupervisedMotion("run", params, f"run {name_of(record)}", run.seconds(), caption))

    async def check_start(self) -> SupervisedMotion:
        """Return the start of all servos after a stop: each holds its angle, and obeys the next movement."""
        params = {"servo": "all", "start": True, "hold": True}
        return SupervisedMotion("servo.set", params, "hold and start all servos", 0.0)

    def ticket(self) -> Ticket:
        """Return the ticket of a motion that is requested now, and has still to be checked."""
        return self._stops.ticket()

    def ask(self, motion: SupervisedMotion, ticket: Ticket | None = None) -> Question:
        """Return a question for a person, in place of any earlier one; `ticket` is that of the request, None for now.

        Raise RequestRefused if motions are off, MotionRefused if a stop came since the request.
        """
        if not self.may_move:
            raise RequestRefused(f"not moved: {motion.text}; motions are off here, --allow-motion turns them on")
        number = secrets.randbelow(1 << 53)  # a model that could guess it would answer for the person
        requested = self.ticket() if ticket is None else ticket
        question = Question(motion, msgspec.structs.replace(requested, until=self._now() + OPEN), number)
        self._check_stops(question)
        self._question = question
        return question

    def answer(self, number: int, *, is_yes: bool) -> Permission:
        """Return the permission for the motion of a question; each question is answered once.

        Raise MotionRefused for a no, and for the answer to another question than the latest.
        """
        question, self._question = self._question, None
        if question is None or question.number != number:
            raise MotionRefused("not moved: this question is not open any more; ask again")
        if not is_yes:
            raise self._refused(question.motion, "the person said no")
        self._check(question)
        return Permission(question.motion, msgspec.structs.replace(question.ticket, until=self._now() + PERMITTED))

    async def ask_in_studio(self, motion: SupervisedMotion, ticket: Ticket | None = None) -> Permission:
        """Return the permission of a person at a page of the studio that shows this board; `ticket` is as for `ask`.

        Raise MotionRefused for a no and without an answer, NotFound without a page that may move the robot.
        """
        question = self.ask(motion, ticket)
        try:
            answer = await self._channel.call("question.ask", **_asked(motion))
        except asyncio.CancelledError:
            self._channel.tell("question.withdraw")
            raise
        except MotionRefused as error:
            raise self._refused(motion, str(error), error.reason) from error
        return self.answer(question.number, is_yes=msgspec.json.decode(answer, type=Answer).is_yes)

    def permit_unasked(self, motion: SupervisedMotion, ticket: Ticket | None = None) -> Permission:
        """Return a permission without a question, for `--no-ask`; `ticket` is as for `ask`."""
        return self.answer(self.ask(motion, ticket).number, is_yes=True)

    def is_valid(self, permission: Permission) -> bool:
        """Return whether the motion of a permission could begin now."""
        return self._stops.holds(permission.ticket) and self._now() <= permission.ticket.until

    async def perform(self, permission: Permission) -> None:
        """Carry out a motion that is permitted, and return at its end.

        A cancellation, the end of this program or of the connection with the hub, and 10 s stop all servos.

        Raises:
            MotionRefused: The permission is void, another program moves the board, or a stop ended the motion.
        """
        motion, ticket = permission
        if self._is_moving:
            raise self._refused(motion, "another motion is under way; wait for its end")
        self._check(permission)
        self._is_moving = True
        beats: asyncio.Task[None] | None = None
        try:
            async with asyncio.timeout(LONGEST):
                await self._channel.call("lease.take", dead_man=_DEAD_MAN)
                beats = asyncio.create_task(self._beat())
                self._check(permission)
                self._stopped.clear()
                await self._channel.call(motion.method, until=ticket.until, **motion.params)
                await self._last(motion)
        except ServolinkError as error:  # first: some of them are TimeoutErrors too
            self._log(f"{motion.text}: {error}")
            raise
        except TimeoutError:
            self._channel.tell("stop")
            raise self._refused(motion, f"it took longer than {LONGEST:g} s, and was stopped") from None
        except BaseException:  # the client that called has left, or this program ends
            self._channel.tell("stop")
            self._log(f"{motion.text}: stopped, as the program that asked for it has gone")
            raise
        finally:
            self._is_moving = False
            if beats is not None:
                beats.cancel()
            self._channel.tell("lease.give")
        self._log(f"{motion.text}: done")

    async def stop(self) -> None:
        """Stop all servos, also for other programs. Raise OutcomeUnknown without a report of all servos."""
        self._stop("a stop came first")
        self._log("stop of all servos")
        await self._channel.call("stop")

    async def _refuse_idle(self, servo_ids: Collection[int]) -> None:
        """Raise MotionRefused if one of the servos ignores movements."""
        for servo in await self.board.servos():
            if servo.state != "ready" and (servo.servo_id in servo_ids or ALL_SERVOS in servo_ids):
                text = f"servo {servo.servo_id} is {servo.state}, and ignores movements until it is started"
                raise MotionRefused(text, reason=Reason.SERVO_STATE)

    async def _last(self, motion: SupervisedMotion) -> None:
        """Return after the planned duration. Raise MotionRefused after a stop."""
        with suppress(TimeoutError):
            async with asyncio.timeout(motion.seconds):
                await self._stopped.wait()
                raise MotionRefused(f"{motion.text}: {self._stops.reason}", reason=Reason.STOP)

    async def _beat(self) -> None:
        while True:
            self._channel.tell("lease.beat")
            await asyncio.sleep(_BEAT)

    def _check(self, asked: Permission | Question) -> None:
        """Raise MotionRefused if a stop came since, or if the time is over."""
        self._check_stops(asked)
        if self._now() > asked.ticket.until:
            raise self._refused(asked.motion, "the permission is too old; ask again")

    def _check_stops(self, asked: Permission | Question) -> None:
        if not self._stops.holds(asked.ticket):
            raise self._refused(asked.motion, self._stops.reason, Reason.STOP)

    def _refused(self, motion: SupervisedMotion, why: str, reason: Reason = Reason.OTHER) -> MotionRefused:
        self._log(f"{motion.text}: {why}")
        return MotionRefused(f"{motion.text}: {why}", reason=reason)

    def _stop(self, reason: str) -> None:
        self._stops.stop(reason)
        self._stopped.set()

    def _hear(self, method: str, params: Raw) -> None:
        """Take a notification of the hub: the stop of another program voids questions and permissions."""
        if method == "stopped":
            notice = msgspec.json.decode(params, type=StoppedNotice)
            why = "" if notice.stalled is None else f": {escape(notice.reason)}"
            self._stop(f"{escape(notice.by or 'the hub')} has stopped all servos{why}")


def _checked(motion: SupervisedMotion) -> SupervisedMotion:
    """Return the motion. Raise MotionRefused if it lasts too long."""
    most = LONGEST - _FOR_THE_LINE
    if not motion.seconds <= most:
        raise MotionRefused(f"{motion.text}: {motion.seconds:.1f} s are too long; at most {most:g} s are allowed")
    return motion


def _asked(motion: SupervisedMotion) -> dict[str, Any]:
    """Return the params of a question about a motion."""
    targets, record = motion.params.get("targets", {}), motion.params.get("type")
    return {"seconds": motion.seconds, "targets": targets, "record": record, "caption": motion.caption}


@asynccontextmanager
async def supervised(
    hub: str, *, may_move: bool, speed_cap: float, log: Callable[[str], None]
) -> AsyncIterator[Supervisor]:
    """Join the hub named `hub` in this context; all motions are slower than `speed_cap` degrees per second.

    Raise OpenError without such a hub.
    """
    role: RoleName = "move" if may_move else "watch"
    channel, _ = await open_channel(hub, Greeting(wants="rpc", who=this_program(), role=role, dead_man=_DEAD_MAN))
    try:
        tighten = Tighten(speed_cap=speed_cap, source="--speed-cap")
        await channel.call("limits.tighten", timeout=_LIMIT, **msgspec.to_builtins(tighten))
        async with connect(f"share://{hub}?role=watch", speed_cap=speed_cap, reconnect=True) as board:
            yield Supervisor(hub, board, channel, may_move=may_move, log=log)
    finally:
        await channel.close()
