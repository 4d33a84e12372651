"""Guarding: feeds the guard from the readings of the hub, stops the board for a stall, and keeps what is normal."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime

from msgspec.structs import replace

from servolink.boards import BoardIdentityRecord, BoardNormals, ProfileInUse, SafetyLimits, identity_of
from servolink.client import Board, ServoReading, ServoReadings, servos_of
from servolink.control import ProblemNotice, Role
from servolink.errors import MotionRefused, ProfileError, ServolinkError, escape
from servolink.hub.doors.direct import DirectProgram
from servolink.hub.hub import Hub
from servolink.hub.rules.exchanges import MoveOrder
from servolink.hub.rules.guard import AFTERWARDS, Guard, Stall
from servolink.motion import Movement, Ticket
from servolink.protocol import Packet
from servolink.support import Tasks
from servolink.transports import PortIdentity

RESTING_HZ = 1.0
"""Readings per second while nothing moves."""
MOST_HZ = 50.0
"""Most readings per second for the guard while something moves."""
PROMISED_HZ = 10.0
"""Readings per second at which a stall is found within a second."""
SHARE = 0.25
"""Most of the line that the guard takes."""

_logger = logging.getLogger(__name__)

_READINGS = 20  # whose quickest says how long the line takes for one
_EASING = 0.5  # seconds in which a servo is eased off
_PAUSE = 0.5  # seconds until the servos are read again after an error
_KEEPING = 300.0  # seconds between two writings of what is normal: a hub may be killed


class Guarding:
    """Guard of a hub, until closed: it shares the poll of all watchers, which is faster only while servos move."""

    def __init__(self, hub: Hub, open_board: Callable[[], Awaitable[Board]], limits: SafetyLimits) -> None:
        """Watch over the servos of `hub`, read through `open_board`, with the settings in `limits`."""
        self.guard = Guard(limits.temperature)
        self._eased = limits.ease_off or ()
        self._hub = hub
        self._open_board = open_board
        self._now = asyncio.get_running_loop().time
        self._took = deque[float](maxlen=_READINGS)
        self._readings: ServoReadings | None = None
        self._is_slow = False
        profile = hub.board.profile
        self._name = (profile and profile.name) or hub.name
        self._identity: BoardIdentityRecord | None = None  # known after the normals were loaded
        self._kept = 0  # learnt readings in the file
        self._kept_at = self._now()
        self._end_following = hub.follow_requests(self._sent)
        self._tasks = Tasks()
        self._tasks.begin(self._run())

    @property
    def moving_hz(self) -> float:
        """Readings per second while servos move: what a quarter of the line carries, at most 50."""
        quickest = min(self._took, default=0.0)
        return min(MOST_HZ, SHARE / quickest) if quickest > SHARE / MOST_HZ else MOST_HZ

    async def close(self) -> None:
        """Watch no longer."""
        self._end_following()
        await self._tasks.close()
        await self._keep()

    def _sent(self, packet: Packet, outcome: object, asked_at: float, who: str, session_id: str) -> None:
        """Read faster from now on, after a motion."""
        if packet.is_motion and self._readings is not None:
            self._readings.pace(self.moving_hz)

    async def _run(self) -> None:
        told = ""
        while True:
            board = await self._open_board()
            try:
                if self._identity is None:
                    await self._recall(board)
                async with board.watch(RESTING_HZ) as self._readings:
                    async for reading in self._readings:
                        self._take(reading)
            except ServolinkError as error:
                if board.connection.ended is not None:  # the hub has ended
                    return
                if str(error) != told:
                    told = str(error)
                    self._hub.tell(ProblemNotice(f"the guard cannot read the servos: {told}; trying again"))
            else:
                return
            finally:
                self._readings = None
            await asyncio.sleep(_PAUSE)

    def _take(self, reading: ServoReading) -> None:
        """Look at a reading, and decide when to read next."""
        courses, now = self._hub.motions.courses, reading.seconds
        self._took.append(reading.took)
        courses.follow(now)
        for stall in self.guard.stalls(reading.servos, courses.way, now):
            stopping = self._hub.stop_stalled(stall.servo_id, str(stall))
            self._hub.tell(ProblemNotice(f"the guard stops the board: {stall}"))
            if stall.servo_id in self._eased:
                self._tasks.begin(self._ease(stall, stopping))
        for warning in self.guard.warnings(reading.servos, now):
            self._hub.tell(ProblemNotice(f"the guard warns: {warning}"))
        courses.seen({servo.servo_id: int(servo.angle) for servo in reading.servos if not servo.doubt}, now)
        is_moving = now <= courses.end_of_motion() + AFTERWARDS
        if self._readings is not None:
            self._readings.pace(self.moving_hz if is_moving else RESTING_HZ)
        if is_moving:
            self._tell_slow()
        elif now - self._kept_at > _KEEPING:
            self._kept_at = now
            self._tasks.begin(self._keep())

    async def _ease(self, stall: Stall, stopping: asyncio.Task[Ticket | None]) -> None:
        """Turn a stalled servo back by up to 2 degrees, once, unless anything has happened since the stop."""
        ticket = await Tasks.shared_result(stopping)
        if ticket is None:
            return
        try:
            if not _stays(self._hub.board.profile):
                raise MotionRefused("the profile is not certain that a started servo stays (when_started)")
            servo = await (await self._open_board()).servo(stall.servo_id)
            if (angle := stall.eased(int(servo.angle))) is None:
                raise MotionRefused("it has turned since, or knows no way back")
            await self._turn_back(stall, angle, ticket)
            told = f"has eased servo {stall.servo_id} off from {servo.angle} to {angle} degrees, and stops it again"
        except ServolinkError as error:
            told = f"does not ease servo {stall.servo_id} off: {error}"
        self._hub.tell(ProblemNotice(f"the guard {told}"))

    async def _turn_back(self, stall: Stall, angle: int, ticket: Ticket) -> None:
        """Move a servo as a program of the hub does, through all gates; whatever comes of it, stop the board again."""
        program = DirectProgram(self._hub, who="the guard", role=Role.MOVE)
        movement, planner = Movement({stall.servo_id: angle}, duration=_EASING), servos_of(self._hub.board).planner
        order = MoveOrder(movement, planner, start=True, must_stand=True)
        try:
            self._hub.leases.take(program.session_id, force=True)
            plan = await self._hub.move(program.session_id, order, replace(ticket, who=program.session_id))
            await asyncio.sleep(plan.seconds)
        finally:
            self._hub.stop_stalled(stall.servo_id, str(stall))
            self._hub.leases.give(program.session_id)
            await program.close()

    async def _recall(self, board: Board) -> None:
        """Load the normals from earlier runs with this board; ignore those of another board with the same name."""
        port = await asyncio.to_thread(identity_of, self._hub.url) or PortIdentity()
        identity = BoardIdentityRecord.of(
            servo_ids=tuple(await board.servo_ids()),
            vendor_id=port.vendor_id,
            product_id=port.product_id,
            serial_number=port.serial_number or None,
        )
        if (kept := await asyncio.to_thread(BoardNormals.load, self._name)) is not None:
            at = datetime.now(UTC)
            self.guard.recall(kept.trusted(identity, at), self._now(), at)
        self._identity = identity

    async def _keep(self) -> None:
        """Save the normals, unless the file is up to date."""
        if self._identity is None or self._kept == self.guard.learnt:
            return
        self._kept = self.guard.learnt
        normals = BoardNormals(self._identity, self.guard.kept(self._now(), datetime.now(UTC)))
        try:
            await asyncio.to_thread(normals.save, self._name)
        except ProfileError as error:
            _logger.warning("%s", escape(str(error)))

    def _tell_slow(self) -> None:
        """Say once that the line is too slow for what the guard promises."""
        if self._is_slow or len(self._took) < _READINGS or (hz := self.moving_hz) >= PROMISED_HZ:
            return
        self._is_slow = True
        found = f"a stall is found within {PROMISED_HZ / hz:.1f} s, not within a second"
        self._hub.tell(ProblemNotice(f"a quarter of this line carries {hz:.1f} readings a second to a guard: {found}"))


def _stays(profile: ProfileInUse | None) -> bool:
    """Return whether a started servo certainly stays: on other boards, starting it would repeat the stalled motion."""
    if profile is None or profile.settings.when_started != "stays":
        return False
    evidence = profile.profile.evidence.get("when_started")
    return evidence is None or evidence.confidence == "certain"
