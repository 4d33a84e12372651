"""Methods of the control interface for streams of set-points."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

from msgspec.structs import replace

from servolink.client import ServoStream, point_check, servos_of
from servolink.control import Role, StreamBegun, StreamSent, Touches
from servolink.errors import MotionRefused, RequestRefused
from servolink.hub.method_messages import StreamBegin, StreamSend
from servolink.hub.methods.methods import METHODS, Caller
from servolink.motion import MotionLimits, MotionPlanner, SetPoints


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
    ticket = control.hub.stops.ticket(who=control.session)

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
