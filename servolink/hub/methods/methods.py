"""The methods of the control interface. The docstrings are the reference, and the types are checked."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from typing import Any, NamedTuple, TypeVar

from msgspec.structs import replace

from servolink.client import Board
from servolink.control import (
    Battery,
    BoardState,
    Done,
    HubStatus,
    LeaseNow,
    Methods,
    NoParams,
    Ran,
    Role,
    ServoList,
    Tighten,
    Touches,
)
from servolink.errors import RequestTimeout
from servolink.hub.engine.hub_recorder import HubRecorder
from servolink.hub.method_messages import (
    BoardFacts,
    BoardMode,
    ExclusiveUse,
    ExclusiveUseNow,
    LeaseTake,
    LineTest,
    LineTested,
    Move,
    Moved,
    MoveEnd,
    Release,
    Rename,
    Run,
    ServoParameters,
    ServosAck,
    ServoSet,
    ServosList,
    ServosWatch,
    StopHeard,
    Watching,
)
from servolink.hub.methods.context import Control
from servolink.hub.methods.feeds import ButtonsFeed, ServosFeed, TapFeed, servos_now
from servolink.hub.rules.exchanges import HeardStops
from servolink.motion import Ticket
from servolink.project import UNFINISHED
from servolink.protocol import ALL_SERVOS, QueryServoListRequest
from servolink.support import Tasks, seconds_asleep

T = TypeVar("T")

_LOST_AFTER = 1.0
"""Seconds without a response to the query behind test data, after which the query counts as lost."""


class Caller(NamedTuple):
    """Program that calls a method."""

    control: Control
    servos: ServosFeed
    buttons: ButtonsFeed
    tap: TapFeed
    recorder: HubRecorder
    ticket: Ticket
    """When the request was received."""
    stops_heard: HeardStops
    """Stops that the program has acknowledged on this connection."""

    async def board_to_move(self, until: float | None) -> Board:
        """Return the board for a motion, which must begin by `until` (see `Control.board_to_move`)."""
        return await self.control.board_to_move(self.ticket_until(until))

    def ticket_until(self, until: float | None) -> Ticket:
        """Return the ticket of a motion that must begin by `until`; None for any time."""
        return self.ticket if until is None else replace(self.ticket, until=until + seconds_asleep())


METHODS: Methods[Caller] = Methods()


@METHODS.add("status", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
def status(caller: Caller, params: NoParams) -> HubStatus:
    """Return programs, lease, exclusive use and traffic counts of the hub.

    Notifications come from the first request of a program on: call this first, and you miss no change. Those of
    programs that join and leave come only after this was called.
    """
    caller.control.wants_programs = True
    return caller.control.hub.status()


@METHODS.add("rename", Role.WATCH, touches=Touches.SESSION)
def rename(caller: Caller, params: Rename) -> Done:
    """Rename the program. Lease and hold stay unchanged."""
    caller.control.who = params.who
    caller.control.hub.rename(caller.control.session, params.who)
    return Done()


@METHODS.add("board.state", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
def board_state(caller: Caller, params: NoParams) -> BoardState:
    """Return lease, exclusive use, and the state of the connection to the board."""
    hub = caller.control.hub
    return BoardState(hub.state, hub.lease, hub.exclusive_use, hub.another, tuple(sorted(hub.board.unanswered)))


# --- the lease and the hold -------------------------------------------------------------------------------------------


@METHODS.add("lease.take", Role.RUN, touches=Touches.SESSION)
def lease_take(caller: Caller, params: LeaseTake) -> LeaseNow:
    """Take the lease, which every motion needs; a motion takes a free lease by itself.

    MotionRefused names the program that holds it. The lease ends when the program leaves, gives it back, or some
    seconds after the end of its last motion. With `dead_man`, here or in the greeting, the program must call
    `lease.beat` more often than that, or the hub stops the board. This counts as a beat, a motion does not: it may have
    waited long after its program fell silent.
    """
    caller.control.take_lease(force=params.force, dead_man=params.dead_man, is_beat=True)
    return LeaseNow(caller.control.hub.lease)


@METHODS.add("lease.give", Role.WATCH, touches=Touches.SESSION)
def lease_give(caller: Caller, params: NoParams) -> LeaseNow:
    """Give the lease back; programs that lost the lease to this program may take it again. A motion continues."""
    caller.control.prepared = None
    caller.control.hub.leases.give(caller.control.session)
    return LeaseNow(caller.control.hub.lease)


@METHODS.add("lease.beat", Role.WATCH, touches=Touches.SESSION)
def lease_beat(caller: Caller, params: NoParams) -> Done:
    """Confirm that the program still watches over the motion, after taking the lease with `dead_man`."""
    caller.control.hub.leases.beat(caller.control.session)
    return Done()


@METHODS.add("stop.heard", Role.WATCH, touches=Touches.SESSION)
def stop_heard(caller: Caller, params: StopHeard) -> Done:
    """Acknowledge the notification `stopped`, so that the hub carries out again what this program sends from now on.

    A program that calls this once, with `stops` of the welcome, is one that acknowledges stops: what it sent before it
    heard of a stop moves nothing.
    """
    caller.stops_heard.heard = params.number
    return Done()


@METHODS.add("lease.ask", Role.WATCH, touches=Touches.SESSION)
def lease_ask(caller: Caller, params: NoParams) -> LeaseNow:
    """Ask the holder for the lease with a notification; the holder decides."""
    caller.control.hub.leases.ask(caller.control.session)
    return LeaseNow(caller.control.hub.lease)


@METHODS.add("board.hold", Role.EDIT, touches=Touches.SESSION, in_order=True)
async def board_hold(caller: Caller, params: ExclusiveUse) -> ExclusiveUseNow:
    """Take exclusive use of the board: other programs wait, except with stops. Waits while another program has it.

    It ends with `board.release`, or when the program leaves.
    """
    await caller.control.begin_exclusive_use(params.reason)
    return ExclusiveUseNow(caller.control.hub.exclusive_use)


@METHODS.add("board.release", Role.EDIT, touches=Touches.SESSION, in_order=True)
async def board_release(caller: Caller, params: NoParams) -> ExclusiveUseNow:
    """Share the board again with other programs."""
    caller.control.hub.end_exclusive_use(caller.control.session)
    return ExclusiveUseNow(caller.control.hub.exclusive_use)


@METHODS.add("limits.tighten", Role.WATCH, touches=Touches.SESSION)
def limits_tighten(caller: Caller, params: Tighten) -> Done:
    """Limit the motions of this program, in addition to the limits of the board, until the program leaves.

    Call it first: it is refused once the program has moved or changed something or read a record, and on a connection
    that belongs to the `session` of a program with frames.
    """
    caller.control.tighten(params.limits())
    return Done()


# --- servos -----------------------------------------------------------------------------------------------------------


@METHODS.add("stop", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
def stop(caller: Caller, params: NoParams) -> Coroutine[Any, Any, Done]:
    """Stop and hold all servos at once, ahead of all other requests, whichever program has the lease.

    Confirmed by reading the servos: OutcomeUnknown says that not all of them report that they are stopped.
    """
    stopping = caller.control.hub.begin_stop(caller.control.who, caller.control.session)

    async def confirmed() -> Done:
        await Tasks.shared_result(stopping)
        return Done()

    return confirmed()


@METHODS.add("servos.list", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def servos_list(caller: Caller, params: ServosList) -> ServoList:
    """Return the state of all servos. The unit of the angles is set on the board for this reading only."""
    servos = await caller.control.read(Board.servos, partial(caller.control.readings, params.unit))
    return ServoList(servos_now(servos, caller.control.hub.motions.courses, asyncio.get_running_loop().time()))


@METHODS.add("servos.parameters", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def servos_parameters(caller: Caller, params: NoParams) -> ServoParameters:
    """Return caption and angle correction of each servo, as stored on the board."""
    return ServoParameters(await caller.control.read(Board.servo_parameters, caller.control.readings))


@METHODS.add("battery", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def battery(caller: Caller, params: NoParams) -> Battery:
    """Return the charge of the battery. RequestTimeout if the board does not know it."""
    return Battery(await caller.control.read(Board.battery, caller.control.readings))


@METHODS.add("servos.watch", Role.WATCH, touches=Touches.SESSION)
async def servos_watch(caller: Caller, params: ServosWatch) -> Watching:
    """Send the notification `servos` from now on. All programs share one poll of the board.

    A program that does not acknowledge gets two notifications, and then the latest state when it does.
    """
    await caller.servos.watch(params.hz, changed_only=params.changed_only)
    return Watching(params.hz)


@METHODS.add("servos.ack", Role.WATCH, touches=Touches.SESSION)
def servos_ack(caller: Caller, params: ServosAck) -> Done:
    """Acknowledge notifications `servos`; best sent without `id`, as no response is needed."""
    caller.servos.acknowledge(params.number)
    return Done()


@METHODS.add("servos.unwatch", Role.WATCH, touches=Touches.SESSION)
async def servos_unwatch(caller: Caller, params: NoParams) -> Done:
    """Send no more notifications `servos`."""
    await caller.servos.close()
    return Done()


@METHODS.add("buttons.subscribe", Role.WATCH, touches=Touches.SESSION)
async def buttons_subscribe(caller: Caller, params: NoParams) -> Done:
    """Send the notification `button` for each button event from now on."""
    await caller.buttons.subscribe()
    return Done()


@METHODS.add("buttons.unsubscribe", Role.WATCH, touches=Touches.SESSION)
async def buttons_unsubscribe(caller: Caller, params: NoParams) -> Done:
    """Send no more notifications `button`."""
    await caller.buttons.unsubscribe()
    return Done()


@METHODS.add("move", Role.MOVE, touches=Touches.MOTION, from_afar=True, in_order=True)
async def move(caller: Caller, params: Move) -> Moved:
    """Move servos together, within the limits of the board. Motions of one program are carried out in their order.

    MotionRefused says why nothing moved: a limit, another program that holds the lease, or a stop that came, or `until`
    that passed, while another program had exclusive use of the board.
    """
    return Moved(await caller.control.move(params, caller.ticket_until(params.until)))


@METHODS.add("move.end", Role.MOVE, touches=Touches.SESSION | Touches.MOTION, is_urgent=True)
async def move_end(caller: Caller, params: MoveEnd) -> Done:
    """Stop servos at once where they are, after press and hold. The servos hold, and obey the next movement.

    They are started again when they have stopped, but not after a `stop` of all servos. Movements of this program that
    are not sent yet are dropped. OutcomeUnknown says that servos did not report that they are stopped, so that all are
    stopped at once; MotionRefused, that another program has the lease, and nothing was stopped.
    """
    await caller.control.end_move((ALL_SERVOS,) if params.servos is None else params.servos)
    return Done()


@METHODS.add("release", Role.MOVE, touches=Touches.MOTION, from_afar=True, in_order=True)
async def release(caller: Caller, params: Release) -> Done:
    """Stop and release a servo, or all. It goes limp, and a raised limb falls."""
    board = await caller.board_to_move(params.until)
    if params.servo == "all":
        await board.release()
    else:
        await board.release(params.servo)
    return Done()


@METHODS.add("servo.set", Role.MOVE, touches=Touches.MOTION, from_afar=True, in_order=True)
async def servo_set(caller: Caller, params: ServoSet) -> Done:
    """Start or stop a servo, and hold or release its angle. After a stop, a servo moves only when started again."""
    is_stop, control = params.hold and not params.start, caller.control
    board = await (control.board_to_stop(params.servo) if is_stop else caller.board_to_move(params.until))
    await board.set_servo(params.servo, start=params.start, hold=params.hold)
    return Done()


@METHODS.add("run", Role.RUN, touches=Touches.MOTION, from_afar=True, in_order=True)
async def run(caller: Caller, params: Run) -> Ran:
    """Run a stored action or macro. With `wait`, later motions of this program wait too; a stop does not.

    MotionRefused is as for `move`; NotFound says that there is no such record.
    """
    board = await caller.board_to_move(params.until)
    options = {"wait": params.wait, "dry_run": params.dry_run, "any_angle": params.any_angle}
    if params.type == "action":
        return Ran(await board.run_action(params.id, **options))
    await board.run_macro(params.id, **options)
    return Ran(None)


# --- settings ---------------------------------------------------------------------------------------------------------


@METHODS.add("board.facts", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def board_facts(caller: Caller, params: NoParams) -> BoardFacts:
    """Return ids of servos, project id and memory of the board. What the board does not answer is null."""
    project_id = await _answer(caller, Board.project_id)
    memory = await _answer(caller, Board.memory)
    is_marked = project_id is not None and project_id in UNFINISHED
    free = None if memory is None or memory.size < 0 else memory.size
    return BoardFacts(
        await caller.control.read(Board.servo_ids),
        None if is_marked else project_id,
        is_marked,
        free,
        None if memory is None else memory.total_size,
    )


async def _answer(caller: Caller, query: Callable[[Board], Awaitable[T]]) -> T | None:
    """Return the response to a query, None if the board does not know the query."""
    try:
        return await caller.control.read(query)
    except RequestTimeout:
        return None


@METHODS.add("board.mode", Role.EDIT, touches=Touches.BOARD, in_order=True)
async def board_mode(caller: Caller, params: BoardMode) -> BoardMode:
    """Set the transmission mode of the board for all programs: 1 for this protocol, 0 for an older protocol.

    No stop reaches a board in mode 0, so all servos are stopped first, and MotionRefused says that another program has
    the lease. The hub sets mode 1 again when it opens the silent connection anew.
    """
    control = caller.control
    board = await control.board()
    if params.mode == 1:
        await board.set_transmission_mode(1)
        return params
    # Exclusive use keeps other programs from starting a servo between the stop and the new mode.
    async with control.exclusive("the transmission mode is being set"):
        with control.moving():
            await Tasks.shared_result(control.hub.begin_stop(control.who, control.session))
            await board.set_transmission_mode(0)
    return params


@METHODS.add("line.test", Role.EDIT, touches=Touches.NOTHING, in_order=True)
async def line_test(caller: Caller, params: LineTest) -> LineTested:
    """Send test data, which the board ignores, and then a query; return how the query was answered."""
    board, stats = await caller.control.board(), caller.control.hub.board.stats
    # Counters of the hub: a repeated query of any program shows that the line has lost bytes.
    retries, noise = stats.retries, stats.noise
    begun_at = asyncio.get_running_loop().time()
    await board.send_dummy_data(bytes(number % 256 for number in range(params.size)))
    seconds: float | None = None
    try:
        await board.request(QueryServoListRequest(), timeout=_LOST_AFTER)
        seconds = asyncio.get_running_loop().time() - begun_at
    except RequestTimeout:
        pass
    return LineTested(seconds, stats.retries - retries, stats.noise - noise)
