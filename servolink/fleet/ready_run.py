"""ReadyRun: run that a board begins when the message comes that starts all boards together."""

from __future__ import annotations

import asyncio

import msgspec
from msgspec.structs import replace

from servolink.control import Done, Ran, RunStarted, ServoList
from servolink.errors import MotionRefused, NotFound, Reason
from servolink.fleet.hub_session import HubSession, result_of
from servolink.fleet.topics import Prepare, Prepared
from servolink.motion import StopCounter, Ticket
from servolink.support import seconds_asleep, time_with_sleep


class ReadyRun:
    """Slot for a run, checked by the hub and kept ready, with the lease."""

    def __init__(self, hub: HubSession, stops: StopCounter) -> None:
        """Use the board of `hub`, whose stops are counted by `stops`."""
        self.is_none = asyncio.Event()
        """Set unless a run is prepared or being started: less urgent work waits for the event."""
        self.is_none.set()
        self._hub = hub
        self._prepared: Prepare | None = None
        self._stops = stops
        self._ticket = stops.ticket()
        self._timer: asyncio.TimerHandle | None = None

    async def prepare(self, asked: Prepare, ticket: Ticket) -> Prepared:
        """Ask the hub to check a run and keep the run ready, with the lease. Raise the error of the hub.

        The hub refuses what it cannot begin to check in the time of `ticket`. Raise MotionRefused if a stop comes
        meanwhile.
        """
        self.forget()
        run = {"type": asked.run.type, "id": asked.run.id, "until": ticket.until - seconds_asleep()}
        checked = result_of(await self._hub.ask("run.prepare", run))
        # Read now: of a stop just before, the latest reading for watchers may not know.
        listed = msgspec.json.decode(result_of(await self._hub.ask("servos.list", {})), type=ServoList)
        idle = tuple(each.servo_id for each in listed.servos if not (each.is_start and each.is_hold))
        if not self._stops.holds(ticket):
            self._hub.tell("lease.give")
            raise MotionRefused("the board was stopped while this was prepared; nothing was moved", reason=Reason.STOP)
        self.is_none.clear()
        self._prepared, self._ticket = asked, replace(ticket, until=time_with_sleep() + asked.expires)
        self._timer = asyncio.get_running_loop().call_later(asked.expires, self.forget)
        return Prepared(msgspec.json.decode(checked, type=Ran).seconds, idle)

    def is_for(self, start: str) -> bool:
        """Return whether the message with this id starts the prepared run."""
        return self._prepared is not None and self._prepared.start == start

    async def start(self, at: float) -> RunStarted:
        """Begin the prepared run, once, at this time of the loop. Raise MotionRefused after the time.

        An error of the hub is raised as well.
        """
        prepared, ticket = self._prepared, self._ticket
        self._drop()
        if prepared is None or not self._stops.holds(ticket) or time_with_sleep() > ticket.until:
            self.is_none.set()
            raise MotionRefused("the prepared run has expired; nothing was moved", reason=Reason.DEADLINE)
        try:
            return msgspec.json.decode(result_of(await self._hub.ask("run.start", {"at": at})), type=RunStarted)
        finally:
            self.is_none.set()

    def cancel(self, start: str) -> Done:
        """Forget the run prepared for this start. Raise NotFound without a prepared run."""
        if not self.is_for(start):
            raise NotFound(f"no run is prepared for {start}")
        self.forget()
        return Done()

    def forget(self) -> None:
        """Forget the prepared run, and give the lease back."""
        if self._prepared is not None:
            self._drop()
            self.is_none.set()
            self._hub.tell("lease.give")

    def _drop(self) -> None:
        self._prepared = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
