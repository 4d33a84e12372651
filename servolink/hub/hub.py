"""Hub: one process owns a board, and any number of programs use it at once (docs/design/hub.md)."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import Any, TypeAlias

from servolink.client.board import Board
from servolink.client.events import ButtonEvent
from servolink.client.reconnect import ConnectionState
from servolink.errors import ConnectionLost, MotionRefused, OutcomeUnknown, Rejected, ServolinkError
from servolink.escaping import escape
from servolink.hub.events import ButtonRelay
from servolink.hub.exchanges import Exchange
from servolink.hub.lease import SECONDS_AFTER
from servolink.hub.lease_keeper import LeaseKeeper
from servolink.hub.motion_gate import stops_all
from servolink.hub.motions import Motions
from servolink.hub.notices import (
    ButtonPressed,
    ConnectionChanged,
    HoldChanged,
    HoldStatus,
    HubStatus,
    LeaseStatus,
    Notice,
    Problem,
    ProgramJoined,
    ProgramLeft,
    ProgramRenamed,
    ProgramStatus,
    Refused,
    Stopped,
)
from servolink.hub.program import Program
from servolink.hub.roles import Role
from servolink.hub.sending import PacketSender
from servolink.hub.stopping import stop_each
from servolink.hub.unit_switch import UnitSwitch
from servolink.hub.upstream import Upstream, outcome_of
from servolink.motion.angles import AngleUnit
from servolink.protocol.codec import Codec
from servolink.protocol.editing import ExecuteMacroRequest, ExecuteMacroResponse
from servolink.protocol.packet import Packet
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
)

RequestFollower: TypeAlias = Callable[[Packet, object, float, str, str], None]

_logger = logging.getLogger(__name__)


class Hub:
    """Shares one board among programs, each of which uses it as if it were alone."""

    def __init__(self, board: Board, *, name: str, lease_seconds: float = SECONDS_AFTER) -> None:
        """Use `share`, which opens and closes the hub."""
        self.board = board
        self.name = name
        self.programs: dict[str, Program] = {}
        """By session id, in the order in which they joined."""
        self.doors: tuple[str, ...] = ()
        """The addresses at which it is served, for its status."""
        self._buttons = ButtonRelay(board, self._deliver)
        units = UnitSwitch(board)
        self.motions = Motions(board)
        """How motions are sent to the board, and how long they last."""
        self._keeper = LeaseKeeper(
            name,
            self.motions,
            units,
            lease_seconds,
            who_of=self._who_of,
            tell=self.tell,
            stop_board=self._stop_for,
            begin=self._begin,
        )
        sender = PacketSender(board, self.motions, self._keeper, units, self._buttons, self._alone, self._refused)
        self._upstream = Upstream(board, sender)
        self._now = asyncio.get_running_loop().time
        self._began_at = self._now()
        self._joined_at: dict[str, float] = {}
        self._listeners: list[Callable[[Notice], None]] = []
        self._followers: tuple[RequestFollower, ...] = ()
        self._state: ConnectionState = "connected"
        self._another = ""
        self._hold: HoldStatus | None = None
        self._responses_to_left = 0
        self._tasks = set[asyncio.Task[None]]()

    @property
    def url(self) -> str:
        """The address of the board."""
        return self.board.url

    @property
    def state(self) -> ConnectionState:
        """The state of the connection to the board."""
        return self._state

    @property
    def another(self) -> str:
        """Who answers in place of a board that is lost, and who is expected; empty if nobody does."""
        return self._another

    def start(self) -> None:
        """Begin to serve programs."""
        self._upstream.start()
        self._begin(self._follow_connection())

    async def close(self) -> None:
        """End all sessions. The board stays open, and as it is; stopped if a program watched over its motion."""
        lease = self.lease
        if lease is not None and lease.dead_man is not None:
            with suppress(ServolinkError):
                await self.stop("the hub, which ends,")
            self.give_lease(lease.session)
        for program in list(self.programs.values()):
            if program.on_end is not None:
                program.on_end()
            program.leave()
        await self._upstream.close()
        self._keeper.close()
        while self._tasks:  # one that ends may begin another
            for task in self._tasks:
                task.cancel()
            await asyncio.wait(self._tasks)
        await self._buttons.close()

    # --- programs -----------------------------------------------------------------------------------------------

    def join(
        self,
        sink: Callable[[bytes], None],
        *,
        who: str,
        door: str,
        role: Role = Role.EDIT,
        codec: Codec | None = None,
        unit: AngleUnit = "degree",
        session_id: str | None = None,
    ) -> Program:
        """Begin the session of a program. `sink` takes whole frames for it; it must neither block nor raise.

        `unit` is that of its angles until it sets another one. Raise ValueError if the session id is in use.
        """
        codec = codec or self.board.codec
        program = Program(self, sink, codec, who=who, door=door, role=role, unit=unit, session_id=session_id)
        if program.session_id in self.programs:
            raise ValueError("this session has begun already")
        self.programs[program.session_id] = program
        self._joined_at[program.session_id] = self._now()
        self.tell(ProgramJoined(program.session_id, who, door, str(role)))
        return program

    def rename(self, session_id: str, who: str) -> None:
        """Call a program `who` from now on. No effect if it has left."""
        program = self.programs.get(session_id)
        if program is not None:
            program.who = who
            self.tell(ProgramRenamed(session_id, who))

    def forget(self, program: Program) -> None:
        """End what a program that leaves has here; see `Program.leave`."""
        if self.programs.get(program.session_id) is not program:
            return
        self._keeper.left(program.session_id)  # which names it
        del self.programs[program.session_id]
        self._joined_at.pop(program.session_id)
        self._responses_to_left += program.counters.responses
        self._upstream.waiting.drop(program.queue)
        if program.session_id in self._buttons.subscribers:
            self._begin(self._buttons.left(program.session_id))
        self.release_hold(program.session_id)
        self.tell(ProgramLeft(program.session_id, program.who))

    # --- what programs ask --------------------------------------------------------------------------------------

    def ask(self, exchange: Exchange) -> None:
        """Send a request when it is its turn; see `Program`."""
        self._upstream.ask(exchange)

    def ask_stop(self, exchange: Exchange) -> None:
        """Send a stop before everything else; see `Program`."""
        self._drop_motions()
        if stops_all(exchange.packet):
            self._upstream.stopped_all()
            self._keeper.stopped()
        else:
            exchange.program.servo_stops += 1
        self._upstream.ask_stop(exchange)

    def ask_waiting(self) -> None:
        """Send the requests of a program that reads again; see `Program`."""
        self._upstream.send_waiting()

    @property
    def stops(self) -> int:
        """How many times servos were stopped, which ends all motions that were asked for."""
        return self._upstream.stops

    async def run(
        self,
        session_id: str,
        packet: ExecuteActionExRequest | ExecuteMacroRequest,
        stops: int,
        seconds: float | None,
    ) -> None:
        """Run a stored record for a program, before all that waits; it is not checked against limits of the program.

        `seconds` is how long it lasts, if that is known. Raise MotionRefused if that must not be: without the lease, or
        if there were more than `stops` stops. Raise Rejected if the board refuses.
        """
        program = self.programs.get(session_id)
        if program is None:
            raise ConnectionLost("the session has ended; connect again")
        exchange = Exchange(program, packet, stops, asked_at=self._now(), seconds=seconds)
        response = await self._upstream.begin(exchange)
        if exchange.refused:
            raise MotionRefused(f"nothing was moved: {exchange.refused}")
        if response == ExecuteMacroResponse(0):
            raise Rejected(f"{self.url} refused to run what was prepared", packet)

    async def stop(self, who: str) -> None:
        """Stop all servos for `who`, ahead of everything (see `Board.stop`)."""
        await asyncio.shield(self.begin_stop(who))

    def begin_stop(self, who: str) -> asyncio.Task[SetServoParameterResponse]:
        """Begin what `stop` does, and return the task that confirms it; others may wait for it too: do not cancel it.

        A stop for which nothing was moved since another one began ends with that.
        """
        _logger.info("%s stops the board", escape(who))
        self._drop_motions()
        self._upstream.stopped_all()
        self._keeper.stopped()
        packet, begun = SetServoParameterRequest(ALL_SERVOS, 0, 1), self._now()
        stopping = self._upstream.stop(packet)
        stopping.add_done_callback(lambda task: self._tell_stop(ALL_SERVOS, outcome_of(task), begun, who))
        return stopping

    async def end_move(self, session_id: str, servo_ids: Sequence[int]) -> None:
        """Stop servos where they are, and start them again, so that they hold and obey the next movement.

        For a program that lets go of what it moves; one id of 255 means all servos. They stay stopped if somebody stops
        all servos meanwhile, or has, and nobody has started any since. Raise OutcomeUnknown if they do not report that
        they are stopped: then all servos are, without a connection as soon as there is one. Raise MotionRefused, and
        stop nothing, if another program has the lease.
        """
        program = self.programs.get(session_id)
        if program is None:
            raise ConnectionLost("the session has ended; connect again")
        if self.lease is not None and self.lease.session != session_id:
            raise MotionRefused(f"nothing was stopped: {self.lease_reason(session_id)}")
        self._drop_motions()
        stops = self.stops
        try:
            await self._stop_servos(servo_ids, program.who)
        except ServolinkError as error:
            self._begin(self._stop_for(f"{program.who} has let go"))
            raise OutcomeUnknown(f"{error}; all servos are stopped instead") from error
        # A board may turn a servo that is started to its old target: only those are that have stopped (3.2.3).
        for servo_id in servo_ids:
            if self._upstream.is_stopped or (self._hold is not None and self._hold.session != session_id):
                return
            packet = SetServoParameterRequest(servo_id, 1, 1)
            await self._upstream.begin(Exchange(program, packet, stops, asked_at=self._now()))

    async def _stop_servos(self, servo_ids: Sequence[int], who: str) -> None:
        """Stop servos, all if 255 is one of them, and tell those who follow requests what became of it."""
        begun = self._now()
        outcome: ServolinkError | bool = False
        try:
            if ALL_SERVOS in servo_ids:
                await asyncio.shield(self._upstream.stop(SetServoParameterRequest(ALL_SERVOS, 0, 1)))
            else:
                await stop_each(self.board, servo_ids)
            outcome = True
        except ServolinkError as error:
            outcome = error
            raise
        finally:
            for servo_id in servo_ids:
                response = SetServoParameterResponse(servo_id, 0, 1) if outcome is True else outcome
                self._tell_stop(servo_id, response, begun, who)

    def _tell_stop(self, servo_id: int, outcome: object, begun: float, who: str) -> None:
        for follow in self._followers:
            follow(SetServoParameterRequest(servo_id, 0, 1), outcome, begun, who, "")

    def _drop_motions(self) -> None:
        """Send no motion that was asked for until now, and tell those who wait to ask for one."""
        self._upstream.drop_motions()
        self.tell(Stopped())

    async def _stop_for(self, reason: str) -> None:
        """Stop all servos because nobody watches over them; without a connection, as soon as there is one again."""
        async for state in self.board.states():
            if state == "closed":
                return
            if state == "lost":
                self.tell(Problem(f"{reason}: the board is stopped as soon as it is connected again"))
                continue
            try:
                await self.stop(reason)
            except ConnectionLost:
                continue
            except ServolinkError as error:
                self.tell(Problem(str(error)))
            return

    def _refused(self, exchange: Exchange, reason: str) -> None:
        """Count a packet that is not sent, and tell why."""
        program = exchange.program
        program.counters.refused += 1
        exchange.refused = reason
        self.tell(Refused(program.session_id, program.who, type(exchange.packet).__name__, reason))

    def _who_of(self, session: str) -> str:
        program = self.programs.get(session)
        return "a program that has left" if program is None else program.who

    def _deliver(self, event: ButtonEvent) -> None:
        for program in list(self.programs.values()):
            if program.state.is_subscribed:
                program.push(event)
        self.tell(ButtonPressed(event.button_id, event.event))

    async def _follow_connection(self) -> None:
        async for state in self.board.states():
            self.board.connection.on_more_callers(self._upstream.send_waiting)  # another one after a reconnect
            if state != self._state:
                self._state, self._another = state, ""
                if state == "lost":
                    self.board.connection.on_another = self._found_another
                self.tell(ConnectionChanged(state))

    def _found_another(self, text: str) -> None:
        """Tell that another board answers in place of the one that is lost, or, without `text`, does no longer."""
        self._another = text
        self.tell(ConnectionChanged(self._state, text))

    def _begin(self, doing: Coroutine[Any, Any, None]) -> None:
        """Run a task that ends with the hub at the latest."""
        task = asyncio.get_running_loop().create_task(doing)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    # --- the motion lease ---------------------------------------------------------------------------------------

    @property
    def lease(self) -> LeaseStatus | None:
        """Which program may move the robot; None if none has."""
        return self._keeper.status

    def take_lease(
        self, session_id: str, *, dead_man: float | None = None, force: bool = False, is_beat: bool = True
    ) -> bool:
        """Give the lease to a program if it is free, or with `force`. Return whether it has the lease now.

        If the program then sends no beat for `dead_man` seconds (0.05..60), or leaves, the board is stopped. With
        `is_beat` this counts as one.
        """
        return self._keeper.take(session_id, dead_man=dead_man, force=force, is_beat=is_beat)

    def lease_reason(self, session_id: str) -> str:
        """Return why a program may not move the servos, and what to do; empty if it may."""
        return self._keeper.reason(session_id)

    def give_lease(self, session_id: str) -> None:
        """Free the lease if this program holds it. A motion ends by itself."""
        self._keeper.give(session_id)

    def ask_for_lease(self, session_id: str) -> None:
        """Tell the holder of the lease that this program asks for it."""
        self._keeper.ask(session_id)

    def beat(self, session_id: str) -> None:
        """Count a sign of life of a program that holds the lease with a dead-man time."""
        self._keeper.beat(session_id)

    # --- exclusive use ------------------------------------------------------------------------------------------

    @property
    def held_by(self) -> HoldStatus | None:
        """The program that holds the board alone."""
        return self._hold

    def hold(self, session_id: str, reason: str) -> bool:
        """Make all others wait until `release_hold`. Return whether that is possible: nobody else does it."""
        if self._hold is not None:
            return self._hold.session == session_id
        program = self.programs[session_id]
        self._hold = HoldStatus(session_id, program.who, reason)
        self._upstream.waiting.holder = program.queue
        self.tell(HoldChanged(session_id, program.who, reason))
        return True

    def release_hold(self, session_id: str) -> None:
        """End the exclusive use, if it is that of this session."""
        if self._hold is None or self._hold.session != session_id:
            return
        self._hold = None
        self._upstream.waiting.holder = None
        self._upstream.send_waiting()
        self.tell(HoldChanged(None, None, ""))

    @contextmanager
    def _alone(self, exchange: Exchange) -> Iterator[None]:
        """Make others wait while a packet is carried out that nothing may come between."""
        session, is_held = exchange.program.session_id, self._hold is not None
        if not is_held:
            self.hold(session, f"it sends {type(exchange.packet).__name__}")
        try:
            yield
        finally:
            if not is_held:
                self.release_hold(session)

    # --- notices and status -------------------------------------------------------------------------------------

    def listen(self, listener: Callable[[Notice], None]) -> Callable[[], None]:
        """Call `listener` with each notice; it must not raise. Return what ends that."""
        self._listeners.append(listener)

        def end() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return end

    def follow_requests(self, follow: RequestFollower) -> Callable[[], None]:
        """Call `follow` with each request that is over, but not a query with a response. Return what ends that.

        It gets the packet, the response, True for one that boards do not answer, False or a reason for one that was
        not sent, or an error; when it was asked, who asked, and the session, empty for the hub itself. It must not
        raise.
        """
        self._followers = (*self._followers, follow)
        self._upstream.on_over = self._over

        def end() -> None:
            self._followers = tuple(each for each in self._followers if each is not follow)
            if not self._followers:
                self._upstream.on_over = None

        return end

    def _over(self, exchange: Exchange, outcome: object) -> None:
        program = exchange.program
        for follow in self._followers:
            follow(exchange.packet, outcome, exchange.asked_at, program.who, program.session_id)

    def tell(self, notice: Notice) -> None:
        """Pass a notice to all who listen."""
        for listener in list(self._listeners):
            listener(notice)

    def status(self) -> HubStatus:
        """Return who uses the board, and what has passed."""
        now = self._now()
        return HubStatus(
            self.name,
            self.url,
            self._state,
            now - self._began_at,
            tuple(self._status_of(program, now) for program in self.programs.values()),
            self.lease,
            self._hold,
            self._responses_to_left + sum(program.counters.responses for program in self.programs.values()),
            self.board.stats.noise,
            self.doors,
            self._another,
        )

    def _status_of(self, program: Program, now: float) -> ProgramStatus:
        counters = program.counters
        return ProgramStatus(
            program.session_id,
            program.who,
            program.door,
            str(program.role),
            now - self._joined_at[program.session_id],
            program.waiting,
            counters.requests,
            counters.responses,
            counters.unanswered,
            counters.refused,
            counters.ignored,
            program.garbage,
        )


@asynccontextmanager
async def share(board: Board, *, name: str = "board", lease_seconds: float = SECONDS_AFTER) -> AsyncIterator[Hub]:
    """Share `board`, which should be opened with `reconnect=True, angle_unit=None`, until the block ends.

    The motion lease of a program lasts `lease_seconds` after the end of its last motion. The board stays open. Nothing
    is served by itself: see `servolink.hub.doors`.
    """
    hub = Hub(board, name=name, lease_seconds=lease_seconds)
    hub.start()
    try:
        yield hub
    finally:
        await hub.close()
