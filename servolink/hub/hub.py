"""Hub: process that owns a board, shared by any number of programs at the same time (docs/design/hub.md)."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import ClassVar

from msgspec import Struct

from servolink.client import Board, ButtonEvent, servos_of
from servolink.control import (
    ConnectionNow,
    ConnectionState,
    HoldNotice,
    HoldStatus,
    HubStatus,
    LeaseStatus,
    ProgramNotice,
    RefusedNotice,
    Role,
)
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    MotionRefused,
    OutcomeUnknown,
    Reason,
    Rejected,
    ServolinkError,
)
from servolink.hub.engine.button_relay import ButtonRelay
from servolink.hub.engine.forecast_gate import ForecastGate
from servolink.hub.engine.hub_gates import Standstill, nothing_moved, refuse_other_use
from servolink.hub.engine.lease_keeper import LeaseKeeper
from servolink.hub.engine.motions import Motions
from servolink.hub.engine.program import FrameProgram, Program
from servolink.hub.engine.questions import Questions
from servolink.hub.engine.sending import PacketSender
from servolink.hub.engine.stop_order import MotionsCancelled, Stops
from servolink.hub.engine.unit_switch import UnitSwitch
from servolink.hub.engine.upstream import RequestFollower, Upstream
from servolink.hub.rules.exchanges import Exchange, MoveOrder, RunEnd
from servolink.hub.rules.lease import SECONDS_AFTER
from servolink.hub.rules.tried import MotionTwin, Uncertain
from servolink.motion import AngleUnit, MotionPlan, SetPoints, StopCounter, Ticket
from servolink.protocol import (
    Codec,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    FrameParser,
    Packet,
    SetServoParameterResponse,
    Step,
)
from servolink.support import Tasks

Listener = Callable[[Struct, str], None]
"""Called with a notice, and the session that caused the notice."""


class Hub:
    """Board shared by many programs; each program uses the board like a board of its own."""

    LEASE_SECONDS: ClassVar = SECONDS_AFTER
    """Seconds for which a program keeps the lease after its last motion, unless told otherwise."""

    def __init__(self, board: Board, *, name: str, lease_seconds: float = SECONDS_AFTER) -> None:
        self.board = board
        self.name = name
        self.programs: dict[str, Program] = {}
        """Programs by session id, in the order of joining."""
        self.doors: tuple[str, ...] = ()
        """Addresses of the doors, for the status."""
        self._buttons = ButtonRelay(board, self._deliver)
        self._units = units = UnitSwitch(board)
        self.motions = Motions(board)
        """Sender of motions to the board, with durations."""
        self._tasks = Tasks()
        self.leases = LeaseKeeper(
            name,
            self.motions,
            units,
            lease_seconds,
            who_of=self.name_of,
            tell=self.tell,
            stop_board=self._stop_unwatched,
            tasks=self._tasks,
        )
        """Motion lease, as taken, given, requested and kept alive by programs."""
        self.stops = StopCounter()
        """Counter of stops; each stop cancels all motions requested before."""
        self.standstill = Standstill(self._stood_still)
        """Refusal of motions after a sleep of the computer, or a stop of the process."""
        self._sender = sender = PacketSender(
            board,
            self.motions,
            self.stops,
            self.leases,
            units,
            self._buttons,
            self._exclusive,
            self._refused,
            self.programs,
            self.standstill,
        )
        self._upstream = Upstream(board, sender)
        self._stopping = Stops(
            board, self.stops, sender, self._upstream, self.leases, tell=self.tell, follow=self._over
        )
        self.ask, self.ask_stop, self.ask_waiting = self._upstream.ask, self._stopping.ask, self._upstream.send_waiting
        self.withdraw = self._upstream.withdraw
        """Take the requests and stops of a `Program`, and send held requests when the program reads again."""
        self.quiet = self._upstream.quiet
        """Context in which requests of programs wait, but for stops; a motion right after it finds a free line."""
        self._now = asyncio.get_running_loop().time
        self._began_at = self._now()
        self.questions = Questions(self.tell, self.name_of)
        """Questions of programs to a person at another program."""
        self.forecast: ForecastGate | None = None
        """Gate that tries motions on a twin; None without one."""
        self._listeners: list[Listener] = [self.questions.hear, self._forget_courses]
        self._followers: tuple[RequestFollower, ...] = ()
        self._state: ConnectionState = "connected"
        self._another = ""
        self.exclusive_use: HoldStatus | None = None
        """Program with exclusive use of the board; None without one."""
        self._responses_to_left = 0

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
        """Description of a different board that answers in place of the lost board; empty if none does."""
        return self._another

    def start(self) -> None:
        """Begin to serve programs with the board."""
        self._upstream.start()
        self._tasks.begin(self._follow_connection())

    async def close(self) -> None:
        """End all sessions. The board stays open and unchanged, but is stopped if a program watched over the motion."""
        lease = self.lease
        if lease is not None and lease.dead_man is not None:
            with suppress(ServolinkError):
                await self.stop("the hub, which ends,")
            self.leases.give(lease.session)
        for program in list(self.programs.values()):
            if program.on_end is not None:
                program.on_end()
            program.leave()
        await self._upstream.close()
        self.leases.close()
        await self._tasks.close()
        await self._stopping.close()
        await self._buttons.close()

    def begin_forecast(self, twin: MotionTwin, uncertain: Uncertain = "ask") -> ForecastGate:
        """Try motions on a twin from now on, and return the gate, which must be closed after the hub."""
        gate = ForecastGate(twin, uncertain, self.board, self.motions, self.questions)
        self.follow_requests(gate.sent)
        self._sender.forecast = gate.refuse
        self.forecast = gate
        return gate

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
    ) -> FrameProgram:
        """Begin the session of a program. `sink` takes whole frames for the program, and must neither block nor raise.

        `unit` is that of its angles until it sets another one. Raise ValueError if the session id is in use.
        """
        codec = codec or self.board.codec
        program = FrameProgram(self, sink, codec, who=who, door=door, role=role, unit=unit, session_id=session_id)
        self.add(program)
        return program

    def add(self, program: Program) -> None:
        """Begin the session of a program. Raise ValueError if its session id is in use."""
        if program.session_id in self.programs:
            raise ValueError("this session has begun already")
        self.programs[program.session_id] = program
        self.standstill.begin()
        joined = ProgramNotice("joined", program.session_id, program.who, program.door, str(program.role))
        self.tell(joined, program.session_id)

    def rename(self, session_id: str, who: str) -> None:
        """Rename a program. Nothing happens if the program has left."""
        program = self.programs.get(session_id)
        if program is not None:
            program.who = who
            self.tell(ProgramNotice("renamed", session_id, who), session_id)

    def forget(self, program: Program) -> None:
        """Remove a program that leaves, with the program's lease and requests; see `Program.leave`."""
        if self.programs.get(program.session_id) is not program:
            return
        self.leases.left(program.session_id)  # which names it
        if self.forecast is not None:
            self.forecast.left(program.session_id)
        del self.programs[program.session_id]
        if not self.programs:
            self.standstill.end()
        self._responses_to_left += program.counters.responses
        self._upstream.waiting.drop(program.queue)
        if program.session_id in self._buttons.subscribers:
            self._tasks.begin(self._buttons.left(program.session_id))
        self.end_exclusive_use(program.session_id)
        self.tell(ProgramNotice("left", program.session_id, program.who), program.session_id)

    # --- what programs ask --------------------------------------------------------------------------------------

    async def run(
        self,
        session_id: str,
        packet: ExecuteActionExRequest | ExecuteMacroRequest,
        ticket: Ticket,
        end: RunEnd | None,
    ) -> None:
        """Run a stored record for a program ahead of all waiting requests, unchecked against the program's limits.

        `end` is its end, if that is known. Raise MotionRefused if that must not be: without the lease, or
        after a stop since `ticket` was issued. Raise Rejected if the board refuses.
        """
        program = self._program(session_id)
        exchange = Exchange(program, packet, ticket, asked_at=self._now(), end=end, may_wait=False)
        response = await self._begin(exchange)
        if response == ExecuteMacroResponse(0):
            raise Rejected(f"{self.url} refused to run what was prepared", packet)

    async def move(self, session_id: str, order: MoveOrder, ticket: Ticket) -> MotionPlan:
        """Plan a movement of a program and send it, ahead of all waiting requests. Return the plan.

        Raise the error of a movement that was not sent; MotionRefused without the lease, after a stop since `ticket`
        was issued, and while another program has exclusive use.
        """
        exchange = self._ordered(session_id, order, ticket)
        try:
            await self._begin(exchange)
        except ConnectionLost as error:
            if exchange.is_unsent:
                raise
            raise OutcomeUnknown(str(error), exchange.packet) from error
        assert exchange.plan is not None  # noqa: S101 - narrows the type
        return exchange.plan

    async def plan(self, session_id: str, order: MoveOrder, ticket: Ticket) -> MotionPlan:
        """Return the plan of a movement of a program, without moving anything. Raise as `move`."""
        exchange = self._ordered(session_id, order, ticket)
        await self._units.enter(exchange.packet, exchange.program.units)
        try:
            if refusal := self.standstill.refuse(exchange.packet, ticket, self.stops):
                raise nothing_moved(refusal)
            own = self.board.connection.stops.ticket(until=ticket.until, who=session_id)
            return await servos_of(self.board).plan(order.movement, own, start=order.start, planner=order.planner)
        finally:
            self._units.leave()

    def _ordered(self, session_id: str, order: MoveOrder, ticket: Ticket) -> Exchange:
        """Return the exchange of a movement, with a packet that names its servos until the movement is planned."""
        packet = ExecuteActionRequest(tuple(Step(servo_id, 0, 1) for servo_id in order.movement.targets))
        program = self._program(session_id)
        return Exchange(program, packet, ticket, asked_at=self._now(), order=order, may_wait=False)

    async def check_motion(self, session_id: str, frame: bytes) -> None:
        """Try the motion in a frame of a program on the twin, if there is one.

        Raise MotionRefused if it would be refused there, and ValueError if the frame is not one packet.
        """
        program, found = self._program(session_id), list[Packet]()
        with suppress(DecodeError):
            found += (program.codec.decode(*each) for each in FrameParser(program.codec.byte_order).feed(frame))
        if len(found) != 1:
            raise ValueError("frame must be one whole frame with a packet")
        if self.forecast is not None and found[0].is_motion:
            exchange = Exchange(program, found[0], self.stops.ticket(who=session_id))
            if refusal := await self.forecast.refuse(exchange, is_sent=False):
                raise refusal

    async def set_units(self, session_id: str, packet: Packet) -> None:
        """Set the angle units of a program for `packet` in advance. Raise as `UnitSwitch.enter`."""
        await self._units.enter(packet, self._program(session_id).units)
        self._units.leave()

    async def stream(
        self, session_id: str, targets: Mapping[int, float], points: SetPoints, ticket: Ticket
    ) -> dict[int, int]:
        """Send a movement toward set-points of a program at once, shortened by `points`. Return the angles sent.

        Raise MotionRefused as `run` does, and while another program has exclusive use.
        """
        steps = tuple(Step(servo_id, round(angle), 1) for servo_id, angle in targets.items())
        packet = ExecuteActionRequest(steps)
        exchange = Exchange(self._program(session_id), packet, ticket, asked_at=self._now(), points=points)
        await self._begin(exchange)
        return {step.servo_id: step.degree for step in points.latest}

    async def _begin(self, exchange: Exchange) -> Packet | None:
        """Send a motion ahead of all waiting requests. Raise the refusal of a motion that must not be sent."""
        if refusal := refuse_other_use(self.exclusive_use, exchange.program.session_id):
            raise refusal
        response = await self._upstream.begin(exchange)
        if exchange.error is not None:
            raise nothing_moved(exchange.error)
        return response

    async def stop(self, who: str) -> None:
        """Stop all servos for `who`, ahead of everything (see `Board.stop`)."""
        await Tasks.shared_result(self.begin_stop(who))

    def begin_stop(self, who: str, session_id: str = "") -> asyncio.Task[SetServoParameterResponse]:
        """Begin a stop, and return the task of the confirmation. Do not cancel the task: other programs may wait too.

        Programs of other sessions are told. A stop for which nothing was moved since another one began ends with that.
        """
        return self._stopping.begin(who, session_id)

    async def end_move(self, session_id: str, servo_ids: Sequence[int]) -> None:
        """Stop servos where they are, then start them, to hold and to obey the next movement.

        For a program that lets go of what it moves; one id of 255 means all servos. They stay stopped if somebody stops
        all servos meanwhile, or has, and nobody has started any since. Raise OutcomeUnknown if they do not report that
        they are stopped: then all servos are, without a connection as soon as there is one. Raise MotionRefused, and
        stop nothing, if another program has the lease.
        """
        program = self._program(session_id)
        if self.lease is not None and self.lease.session != session_id:
            raise MotionRefused(f"nothing was stopped: {self.leases.reason(session_id)}", reason=Reason.LEASE)
        await self._stopping.end_move(program, servo_ids)

    def _program(self, session_id: str) -> Program:
        program = self.programs.get(session_id)
        if program is None:
            raise ConnectionLost("the session has ended; connect again")
        return program

    def _stood_still(self, reason: str) -> None:
        self._stopping.stood_still(reason)

    def _stop_unwatched(self, reason: str) -> None:
        self._stopping.begin_unwatched(reason)

    def _refused(self, exchange: Exchange, reason: str) -> None:
        """Count an unsent packet, and report the reason."""
        program = exchange.program
        program.counters.refused += 1
        exchange.refused = reason
        cause = Reason.OTHER if exchange.error is None else exchange.error.reason
        self.tell(RefusedNotice(type(exchange.packet).__name__, reason, cause.value), program.session_id)

    def stop_stalled(self, servo_id: int, reason: str) -> asyncio.Task[Ticket | None]:
        """Stop all servos, as the guard found one stalled; without a connection, as soon as there is one.

        The task returns a ticket as that of `Stops.begin_unwatched` does.
        """
        cancels = MotionsCancelled(are_all=True, reason=reason, stalled=servo_id)
        return self._stopping.begin_unwatched("the guard", cancels)

    def name_of(self, session_id: str) -> str:
        """Return the name of a program for people."""
        program = self.programs.get(session_id)
        return "a program that has left" if program is None else program.who

    def _forget_courses(self, notice: Struct, _: str) -> None:
        """Take a notice: after a stop or a loss of the board, nobody knows where the servos should be."""
        if isinstance(notice, MotionsCancelled | ConnectionNow):
            self.motions.courses.forget()
            if self.forecast is not None:
                self.forecast.forget(records=isinstance(notice, ConnectionNow))

    def _deliver(self, event: ButtonEvent) -> None:
        self.motions.courses.forget()  # the board itself may run a macro for a button
        for program in list(self.programs.values()):
            if program.is_subscribed:
                program.push(event)

    async def _follow_connection(self) -> None:
        async for state in self.board.states():
            self.board.connection.on_more_callers(self._upstream.send_waiting)  # a new connection after a reconnect
            if state != self._state:
                self._state, self._another = state, ""
                if state == "lost":
                    self.board.connection.on_another = self._found_another
                self.tell(ConnectionNow(state))

    def _found_another(self, text: str) -> None:
        """Notify that a different board answers in place of the lost board, or, without `text`, that none does."""
        self._another = text
        self.tell(ConnectionNow(self._state, text))

    # --- the motion lease ---------------------------------------------------------------------------------------

    @property
    def lease(self) -> LeaseStatus | None:
        """Holder of the motion lease; None if the lease is free."""
        return self.leases.status

    # --- exclusive use ------------------------------------------------------------------------------------------

    def begin_exclusive_use(self, session_id: str, reason: str) -> bool:
        """Suspend all other programs until `end_exclusive_use`. Return False if another program has exclusive use."""
        if self.exclusive_use is not None:
            return self.exclusive_use.session == session_id
        program = self.programs[session_id]
        self.exclusive_use = HoldStatus(session_id, program.who, reason)
        self._upstream.waiting.holder = program.queue
        self.tell(HoldNotice(self.exclusive_use), session_id)
        return True

    def end_exclusive_use(self, session_id: str) -> None:
        """End the exclusive use of this session."""
        if self.exclusive_use is None or self.exclusive_use.session != session_id:
            return
        self.exclusive_use = None
        self._upstream.waiting.holder = None
        self._upstream.send_waiting()
        self.tell(HoldNotice(None), session_id)

    @contextmanager
    def _exclusive(self, exchange: Exchange) -> Iterator[None]:
        """Suspend other programs while a packet needs the board exclusively."""
        session, was_exclusive = exchange.program.session_id, self.exclusive_use is not None
        if not was_exclusive:
            self.begin_exclusive_use(session, f"it sends {type(exchange.packet).__name__}")
        try:
            yield
        finally:
            if not was_exclusive:
                self.end_exclusive_use(session)

    # --- notices and status -------------------------------------------------------------------------------------

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call `listener`, which must not raise, with each notice and session. Return a function that ends the calls.

        Notices are the notifications of the control interface and `MotionsCancelled`. A session is empty for the hub.
        """
        self._listeners.append(listener)

        def end() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return end

    def follow_requests(self, follow: RequestFollower) -> Callable[[], None]:
        """Call `follow` with each finished request except answered queries. Return a function that removes `follow`.

        Args:
            follow: Function that never raises, called with the packet, the outcome, the time of the request, the name
                of the program, and its session, empty for the hub itself. The outcome is the response, True for a
                command without a response, False or a reason for an unsent packet, or an error.
        """
        self._followers = (*self._followers, follow)
        self._upstream.on_over = self._over

        def end() -> None:
            self._followers = tuple(each for each in self._followers if each is not follow)
            if not self._followers:
                self._upstream.on_over = None

        return end

    def _over(self, packet: Packet, outcome: object, asked_at: float, who: str, session_id: str) -> None:
        for follow in self._followers:
            follow(packet, outcome, asked_at, who, session_id)

    def tell(self, notice: Struct, session_id: str = "") -> None:
        """Pass a notice to all listeners, with the causing session."""
        for listener in list(self._listeners):
            listener(notice, session_id)

    def status(self) -> HubStatus:
        """Return programs, lease and traffic counts."""
        now = self._now()
        return HubStatus(
            self.name,
            self.url,
            self._state,
            now - self._began_at,
            tuple(program.status() for program in self.programs.values()),
            self.lease,
            self.exclusive_use,
            self._responses_to_left + sum(program.counters.responses for program in self.programs.values()),
            self.board.stats.noise,
            self.doors,
            self._another,
        )


@asynccontextmanager
async def share(board: Board, *, name: str = "board", lease_seconds: float = SECONDS_AFTER) -> AsyncIterator[Hub]:
    """Share a connected board inside this program, until the block ends. The board stays open.

    No other program is let in: `servolink.hub.doors` has the doors.

    Args:
        board: Board that was opened with `reconnect=True, angle_unit=None`.
        name: Name of the hub, in its messages.
        lease_seconds: Seconds, 0 or more, for which a program keeps the lease after its last motion.
    """
    hub = Hub(board, name=name, lease_seconds=lease_seconds)
    hub.start()
    try:
        yield hub
    finally:
        await hub.close()
