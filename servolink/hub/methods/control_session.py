"""ControlSession: control interface for a program, over any carrier of messages."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from weakref import WeakValueDictionary

from msgspec import Struct

from servolink.boards import SafetyLimits
from servolink.control import (
    Greeting,
    Peer,
    ProblemNotice,
    ProgramNotice,
    QuestionNotice,
    QuestionOver,
    RefusedNotice,
    Role,
    StoppedNotice,
)
from servolink.hub.engine.guarding import Guarding
from servolink.hub.engine.hub_recorder import HubRecorder
from servolink.hub.engine.program import FrameProgram
from servolink.hub.engine.stop_order import MotionsCancelled
from servolink.hub.hub import Hub
from servolink.hub.methods import motion_methods, question_methods, stored, tap_methods  # add their methods
from servolink.hub.methods.context import Control, Readings
from servolink.hub.methods.feeds import ButtonsFeed, ServosFeed, TapFeed
from servolink.hub.methods.methods import METHODS, Caller
from servolink.hub.rules.exchanges import HeardStops

__all__ = ["METHODS", "ControlSession", "motion_methods", "question_methods", "stored", "tap_methods"]


class ControlInterface:
    """Control interface of a hub, for any door."""

    def __init__(self, hub: Hub) -> None:
        self._readings = Readings(hub)
        self.recorder = HubRecorder(hub, self._readings.board)
        """Recording started and stopped by programs."""
        self._hub = hub
        self._guarding: Guarding | None = None
        self._groups: WeakValueDictionary[str, asyncio.Semaphore] = WeakValueDictionary()

    def begin_guard(self, *, otherwise: bool) -> None:
        """Begin to watch over the servos if the profile of the board says so, or `otherwise` if it says nothing."""
        profile = self._hub.board.profile
        limits = SafetyLimits() if profile is None else profile.profile.limits
        if otherwise if limits.guard is None else limits.guard:
            self._guarding = Guarding(self._hub, self._readings.board, limits)

    def open_channel(
        self, hub: Hub, greeting: Greeting, session: str, send: Callable[[bytes], None], abort: Callable[[str], None]
    ) -> ControlSession:
        """Begin to serve a program that a door has admitted."""
        reading = asyncio.Semaphore(Peer.MOST_READING)
        if greeting.group:
            reading = self._groups.setdefault(greeting.group, reading)
        return ControlSession(hub, self._readings, self.recorder, greeting, session, send, abort, reading)

    async def close(self) -> None:
        """End the recording, and stop reading the board. Sessions are closed by the doors, earlier."""
        await self.recorder.close()
        if self._guarding is not None:
            await self._guarding.close()
        await self._readings.close()


class ControlSession:
    """Control interface for a program: messages in, responses and notifications out."""

    def __init__(
        self,
        hub: Hub,
        readings: Readings,
        recorder: HubRecorder,
        greeting: Greeting,
        session: str,
        send: Callable[[bytes], None],
        abort: Callable[[str], None],
        reading: asyncio.Semaphore | None = None,
    ) -> None:
        """Call `send` with each message, and `abort`, with the reason, if the program must be disconnected.

        If `greeting` names a session, this is the control interface of a program that has a board already. Programs of
        one group have the same `reading`.
        """
        self.control = Control(hub, readings, greeting, session)
        self._hub = hub
        self._servos = ServosFeed(
            self.control.readings, self._notify, lambda: self._peer.is_paused, hub.motions.courses
        )
        self._buttons = ButtonsFeed(self.control.readings, self._notify)
        self._tap = TapFeed(hub, self._notify, lambda: self._peer.is_paused)
        self._recorder = recorder
        role = Role.parse(greeting.role)
        self._peer: Peer[Caller] = Peer(METHODS, self._caller, send, abort, role=role, reading=reading)
        self._end_listening: Callable[[], None] | None = None
        self._heard = HeardStops()
        self._stopped: StoppedNotice | None = None
        self._told_dropped = 0

    def receive(self, message: bytes | str) -> None:
        """Handle one message; never raises. Empty messages are ignored."""
        if not message.strip():
            return
        if self._end_listening is None:
            self._end_listening = self._hub.listen(self._hear)
        self._peer.receive(message)

    def pause(self) -> None:
        """Send as little as possible: the program does not read."""
        self._peer.pause()

    def resume(self) -> None:
        """Send notifications to the program again."""
        self._peer.resume()
        self._servos.resume()
        if self._peer.dropped > self._told_dropped:
            count, self._told_dropped = self._peer.dropped - self._told_dropped, self._peer.dropped
            self._notify(ProblemNotice(f"this program reads too slowly: {count} notifications were dropped"))
            if self._stopped is not None:  # perhaps among them: without it, the program would move nothing any more
                self._notify(self._stopped)

    async def close(self) -> None:
        """Leave the hub; an import under way is interrupted."""
        if self._end_listening is not None:
            self._end_listening()
        self._tap.stop()
        await self._peer.close()
        self._hub.end_exclusive_use(self.control.session)  # the feeds end with a query, which waits for the end of it
        await self._servos.close()
        await self._buttons.close()
        await self.control.close()

    def _caller(self) -> Caller:
        """Return the context of a request received now: a later stop ends the motion of the request."""
        ticket = self.control.stops.ticket()
        if self._heard.is_behind:
            ticket = ticket.expired()
        return Caller(self.control, self._servos, self._buttons, self._tap, self._recorder, ticket, self._heard)

    def _notify(self, notification: Struct) -> None:
        self._peer.tell(notification)

    def _hear(self, notice: Struct, session: str) -> None:
        """Pass on a notice of the hub, if meant for the program."""
        self.control.heard(notice, session)
        is_own = session == self.control.session
        match notice:
            case MotionsCancelled(are_all, reason, stalled):
                if are_all and not is_own:
                    self._tell_stop(session, reason, stalled)
            case ProgramNotice() if not self.control.wants_programs:
                pass
            case RefusedNotice() if not is_own:
                pass
            case QuestionNotice() | QuestionOver() if self.control.session not in self._hub.questions.shown_by:
                pass
            case _:
                self._notify(notice)

    def _tell_stop(self, session: str, reason: str, stalled: int | None) -> None:
        """Notify of a stop by another program; what arrives before the program has acknowledged it moves nothing."""
        number = self._heard.told = self._hub.stops.count
        if isinstance(program := self._hub.programs.get(self.control.session), FrameProgram):
            program.stops_heard.told = number
        by = self._hub.name_of(session) if session else None
        self._stopped = StoppedNotice(by, reason, stalled, number)
        self._notify(self._stopped)
