"""Methods for motions whose moment counts: runs that are prepared, and streams of set-points."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import reduce

from msgspec.structs import replace

from servolink.client import ServoStream, point_check, servos_of, with_ticket
from servolink.control import Done, Ran, Role, RunStarted, StreamBegun, StreamSent, Touches
from servolink.errors import MotionRefused, Reason, RequestRefused
from servolink.hub.engine.hub_gates import refuse_other_use
from servolink.hub.method_messages import MotionCheck, RunPrepare, RunStart, StreamBegin, StreamSend
from servolink.hub.methods.context import PreparedRun
from servolink.hub.methods.methods import METHODS, Caller
from servolink.motion import MotionLimits, MotionPlanner, SetPoints
from servolink.protocol import ExecuteActionExRequest, ExecuteMacroRequest
from servolink.support import call_at

_LONGEST_LEAD = 1.0
_QUIET = 0.05  # seconds before a start in which the board is asked for nothing; a stop waits no longer for the line


@METHODS.add("run.prepare", Role.RUN, touches=Touches.SESSION | Touches.MOTION, in_order=True)
async def run_prepare(caller: Caller, params: RunPrepare) -> Ran:
    """Check a stored action or macro with all its parts, and take the lease, so that `run.start` begins at once.

    Only the latest one is kept, and `lease.give` forgets it. Errors are those of `run` with `dry_run`, and of
    `lease.take`.
    """
    control = caller.control
    control.prepared, seconds = None, None
    ticket = control.ticket_of_hub(caller.ticket)
    board = await caller.board_to_move(params.until)
    connection = control.hub.board.connection
    packet: ExecuteActionExRequest | ExecuteMacroRequest
    if params.type == "action":
        packet = ExecuteActionExRequest((await board.action(params.id)).action_id)
        seconds = await board.run_action(packet.action_id, dry_run=True)
    else:
        packet = ExecuteMacroRequest((await board.macro(params.id)).macro_id)
        await board.run_macro(packet.macro_id, dry_run=True)
    await control.hub.set_units(control.session, packet)  # else the first start would wait for the board
    if control.hub.forecast is not None:
        await control.hub.forecast.prepare(packet)
    control.take_lease()
    control.prepared = PreparedRun(packet, connection, ticket, await control.hub.motions.end_of(packet))
    return Ran(seconds)


@METHODS.add("run.start", Role.RUN, touches=Touches.SESSION | Touches.MOTION, is_urgent=True)
async def run_start(caller: Caller, params: RunStart) -> RunStarted:
    """Begin the prepared run of `run.prepare` once, at the time `at`, ahead of all waiting requests.

    Programs that begin at the same moment begin closer together than their messages come. Requests of all programs,
    except stops, wait for 50 ms before it, so that no response is in the way. With limits, the run is compared again
    with the present pose, as by `run`, and takes as long. MotionRefused if nothing is prepared, if the board was
    stopped or connected again since, or if another program has the lease.
    """
    control, clock = caller.control, asyncio.get_running_loop().time
    if params.at is not None:
        lead = params.at - clock()
        if lead > _LONGEST_LEAD:
            raise ValueError(f"at must be at most {_LONGEST_LEAD:g} s ahead, not {lead:g} s")
        await _until(params.at - _QUIET)
        if control.prepared is not None:
            with control.hub.quiet():
                await _until(params.at)
    prepared, control.prepared = control.prepared, None
    if prepared is None:
        raise MotionRefused("nothing was moved: nothing is prepared; call run.prepare first")
    if prepared.connection is not control.hub.board.connection:
        raise MotionRefused("nothing was moved: the board was connected again since this was prepared")
    if not control.hub.stops.holds(prepared.ticket):
        raise MotionRefused("nothing was moved: the board was stopped since this was prepared", reason=Reason.STOP)
    if refusal := refuse_other_use(control.hub.exclusive_use, control.session):
        raise refusal
    packet = prepared.packet
    if not control.limits:
        sent = clock()
        await control.hub.run(control.session, packet, prepared.ticket, prepared.end)
        return RunStarted(sent)
    board = with_ticket(await control.board(), caller.ticket)
    if isinstance(packet, ExecuteMacroRequest):
        await board.run_macro(packet.macro_id)
    else:
        await board.run_action(packet.action_id)
    return RunStarted(clock())


@METHODS.add("motion.check", Role.RUN, touches=Touches.SESSION, in_order=True)
async def motion_check(caller: Caller, params: MotionCheck) -> Done:
    """Try a motion on the twin of the hub, if it has one; nothing moves. MotionRefused as for the motion itself."""
    await caller.control.hub.check_motion(caller.control.session, bytes.fromhex(params.frame))
    return Done()


async def _until(at: float) -> None:
    """Wait until a time of the event loop; at least one turn of the loop."""
    loop = asyncio.get_running_loop()
    moment = loop.create_future()
    timer = call_at(loop, at, moment.set_result, None)
    try:
        await moment
    finally:
        timer.cancel()


@METHODS.add("stream.begin", Role.MOVE, touches=Touches.SESSION | Touches.MOTION)
def stream_begin(caller: Caller, params: StreamBegin) -> StreamBegun:
    """Begin a stream of set-points for `stream.send`; an earlier one of this program ends.

    It ends with a stop, `move.end` or the loss of the board, and when no set-point comes for `gap` seconds. The servos
    then keep their last targets. A gap that is no longer than a period is refused.
    """
    control, board = caller.control, caller.control.hub.board
    limits = reduce(MotionLimits.tightened, (limit.limits() for limit in params.limits), control.limits)
    planner = MotionPlanner(limits, servos_of(board).planner.interval_unit)
    points = SetPoints(limits, params.hz, planner.interval_unit, any_angle=params.any_angle)
    ticket = control.ticket_of_hub(caller.ticket)

    async def send_points(angles: Mapping[int, float], until: float) -> Mapping[int, int]:
        return await control.hub.stream(control.session, angles, points, replace(ticket, until=until))

    check_points = point_check(servos_of(board), planner, any_angle=params.any_angle)

    async def check(angles: Mapping[int, float]) -> None:
        try:
            await check_points(angles)
        except RequestRefused:
            if control.hub.stops.holds(ticket):  # after a stop, the refusal of the hub says so
                raise

    control.stream = ServoStream(board, check, send_points, params.hz, params.gap)
    control.streams += 1
    return StreamBegun(control.streams)


@METHODS.add("stream.send", Role.MOVE, touches=Touches.SESSION | Touches.MOTION, is_urgent=True)
async def stream_send(caller: Caller, params: StreamSend) -> StreamSent:
    """Turn servos toward a set-point at once, and return the angles sent when they are sent.

    Angles beyond a limit are replaced by the nearest within, and a way too long for a speed cap is shortened: nothing
    is refused for that. At more than `hz`, or more than the board keeps up with, only the latest set-point is sent.
    MotionRefused says that the stream has ended, or that another program has the lease or the board alone.
    """
    control = caller.control
    if control.stream is None or params.stream != control.streams:
        raise MotionRefused(f"nothing was moved: this program has no stream {params.stream}; begin one")
    sent = await control.stream.send(params.targets)
    return StreamSent({str(servo_id): int(angle) for servo_id, angle in sent.items()})
