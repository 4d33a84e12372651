"""LeaseKeeper: expiry of the motion lease, and a stop of the board when a dead man's beats end."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Iterable

from msgspec import Struct

from servolink.control import LeaseNotice, LeaseStatus
from servolink.errors import escape
from servolink.hub.engine.hub_gates import LeaseGate, LeaseRefused
from servolink.hub.engine.motions import Motions
from servolink.hub.engine.unit_switch import UnitSwitch
from servolink.hub.rules.exchanges import Exchange, RunEnd
from servolink.hub.rules.lease import LeaseChange, MotionLease
from servolink.motion import Ticket
from servolink.protocol import ExecuteActionRequest, ExecuteMacroRequest, Packet
from servolink.support import Tasks, call_at, seconds_asleep

_logger = logging.getLogger(__name__)


class LeaseKeeper:
    """Admits the packets of programs, and keeps the lease of whoever moves the robot."""

    def __init__(
        self,
        name: str,
        motions: Motions,
        units: UnitSwitch,
        seconds_after: float,
        *,
        who_of: Callable[[str], str],
        tell: Callable[[Struct, str], None],
        stop_board: Callable[[str], None],
        tasks: Tasks,
    ) -> None:
        """Keep the lease of the board `name`; `stop_board` begins to stop it, for a reason."""
        self._lease = MotionLease(seconds_after)
        self._gate = LeaseGate(self._lease, name, who_of)
        self._motions = motions
        self._units = units
        self._who_of = who_of
        self._tell = tell
        self._stop_board = stop_board
        self._tasks = tasks
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._is_reading = False
        self._motions_sent = 0
        self._counting = set[asyncio.Task[None]]()  # each of a motion whose end is not known yet

    @property
    def status(self) -> LeaseStatus | None:
        """Holder of the motion lease; None if the lease is free."""
        lease = self._lease
        if lease.holder is None:
            return None
        return LeaseStatus(lease.holder, self._who_of(lease.holder), self._now() - lease.since, lease.dead_man)

    def _now(self) -> float:
        return self._loop.time() + seconds_asleep()  # a program that has slept for hours watches over nothing

    def close(self) -> None:
        """Cancel the timer: leases do not end any more."""
        if self._timer is not None:
            self._timer.cancel()

    # --- what programs do ---------------------------------------------------------------------------------------

    def take_for_motion(self, session: str, dead_man: float | None) -> bool:
        """Give a free lease to a program that is about to move servos. Return whether the program has the lease."""
        if self._lease.holder != session:
            self._report(self._lease.take(session, self._now(), dead_man=dead_man, is_beat=False))
        return self._lease.holder == session

    def refuse(self, packet: Packet, ticket: Ticket) -> LeaseRefused | None:
        """Refuse a motion while another program holds the lease."""
        return self._gate.refuse(packet, ticket, self._now())

    def moved(self, exchange: Exchange) -> None:
        """Count a sent motion: the lease lasts until some time after the end of the motion."""
        packet, session, sent_at = exchange.packet, exchange.program.session_id, self._now()
        self._motions_sent += 1
        if isinstance(packet, ExecuteActionRequest):
            self._count(session, sent_at + self._motions.seconds_of_steps(packet))
            return
        changes = self._motions.courses.changes
        if exchange.end is not None:
            self._count_run(exchange, sent_at, exchange.end, changes)
            return
        if isinstance(packet, ExecuteMacroRequest):  # whose end is known a little later
            self._units.keep_for(exchange.program.units, math.inf)
        counting = self._tasks.begin(self._count_later(exchange, sent_at, changes))
        self._counting.add(counting)
        counting.add_done_callback(self._counting.discard)

    def stopped(self) -> None:
        """Count all motions as over: the board is stopped."""
        for counting in self._counting:
            counting.cancel()
        self._units.release()
        self._report(self._lease.stopped(self._now()))

    def take(self, session: str, *, dead_man: float | None = None, force: bool = False, is_beat: bool = True) -> bool:
        """Give the lease to `session` if free, or with `force`. Return whether `session` has the lease now.

        If the program then sends no beat for `dead_man` seconds (0.05..60), or leaves, the board is stopped. With
        `is_beat` this counts as one.
        """
        self._report(self._lease.take(session, self._now(), dead_man=dead_man, force=force, is_beat=is_beat))
        return self._lease.holder == session

    def reason(self, session: str) -> str:
        """Return the reason why `session` may not move the servos, with a remedy; empty if allowed."""
        return self._gate.reason(session, self._now())

    def give(self, session: str) -> None:
        """Free the lease of `session`, if held. The motion goes on to its end."""
        self._report(self._lease.give(session, self._now()))

    def ask(self, session: str) -> None:
        """Tell the holder that `session` asks for the lease."""
        self._report(self._lease.asked(session, self._now()))

    def beat(self, session: str) -> None:
        """Count a sign of life of the holder."""
        self._report(self._lease.beat(session, self._now()))

    def left(self, session: str) -> None:
        """Free the lease of a session that has ended."""
        self._report(self._lease.left(session, self._now()))

    # --- what time does -----------------------------------------------------------------------------------------

    async def _count_later(self, exchange: Exchange, sent_at: float, changes: int) -> None:
        """Count a motion with an end that must be read from the board, without waiting for the reading."""
        end = await self._motions.end_of(exchange.packet)
        if end is None:
            self._count(exchange.program.session_id, None)
        else:
            self._count_run(exchange, sent_at, end, changes)

    def _count_run(self, exchange: Exchange, sent_at: float, end: RunEnd, changes: int) -> None:
        """Count a stored record that runs until `end`; `changes` is from the moment of the sending."""
        ends_at = sent_at + end.seconds
        self._motions.expect(end, ends_at - seconds_asleep(), changes)
        if isinstance(exchange.packet, ExecuteMacroRequest):
            self._units.keep_for(exchange.program.units, ends_at)
        self._count(exchange.program.session_id, ends_at)

    def _count(self, session: str, ends_at: float | None) -> None:
        self._report(self._lease.moved(session, ends_at, self._now()))
        if self._lease.is_end_unknown and not self._is_reading:
            self._is_reading = True
            self._tasks.begin(self._read_until_rest())

    async def _read_until_rest(self) -> None:
        try:
            seen = -1
            while seen != self._motions_sent:  # a later motion may begin while servos still seem to rest
                seen = self._motions_sent
                await self._motions.until_rest()
        finally:
            self._is_reading = False
        self._units.rested()
        self._report(self._lease.rested(self._now()))

    def _report(self, changes: Iterable[LeaseChange]) -> None:
        """Notify all programs about a change of the lease, and look again when something is due."""
        for change in changes:
            by = None if change.by is None else self._who_of(change.by)
            self._tell(LeaseNotice(change.event, by, self.status), change.by or "")
            who = "" if change.before is None else escape(self._who_of(change.before))
            _logger.info("the motion lease was %s%s", change.event, who and f" ({who} had it)")
            if change.must_stop:
                self._stop_board(f"{who} has gone silent")
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if (due := self._lease.next_due()) is not None:
            self._timer = call_at(self._loop, due - seconds_asleep(), self._timed_out)

    def look(self) -> None:
        """End the lease if its time is over, as after a sleep, in which timers stand still."""
        self._report(self._lease.advance(self._now()))

    def _timed_out(self) -> None:
        self._timer = None
        # Timers may fire a little early: nothing would be due then.
        self._report(self._lease.advance(max(self._now(), self._lease.next_due() or 0.0)))
