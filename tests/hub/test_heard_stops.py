"""Programs acknowledge stops: what one sent before it heard of the stop of another moves nothing, however late.

Module: servolink.hub.rules.exchanges.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.client import connect
from servolink.connection import Tap
from servolink.control import ProblemNotice, Role, StoppedNotice
from servolink.hub.engine.program import FrameProgram
from servolink.hub.hub import Hub
from servolink.hub.methods.control_session import ControlInterface
from servolink.hub.rules.exchanges import HeardStops
from servolink.protocol import (
    Codec,
    ExecuteActionExRequest,
    FrameParser,
    Macro,
    Packet,
    QueryProjectIDRequest,
    SendDummyDataRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.virtual import VirtualBoard
from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared
from tests.hub.door_hub import on_hub, sharing, until

_START = SetServoParameterRequest(1, 1, 1)
_CODEC = Codec()


class Framed:
    """A program with frames, tied to a control interface."""

    def __init__(self, hub: Hub) -> None:
        self.answers: list[bytes] = []
        self.program = hub.join(self.answers.append, who="framed", door="share", role=Role.EDIT, session_id="both")

    def send(self, *packets: Packet) -> None:
        self.program.receive(b"".join(_CODEC.encode(packet) for packet in packets))

    def packets(self) -> list[Packet]:
        """Return the responses so far."""
        frames = FrameParser("little").feed(b"".join(self.answers))
        return [_CODEC.decode(*frame) for frame in frames]


class Sent(Tap):
    """What was sent to the board."""

    def __init__(self, packets: list[Packet]) -> None:
        self._packets = packets
        self._parser = FrameParser("little")

    def sent(self, data: bytes) -> None:
        self._packets += [_CODEC.decode(*frame) for frame in self._parser.feed(data)]


def is_started(here: Shared, servo_id: int) -> bool:
    return bool(here.virtual.servos[servo_id].is_start)


@pytest.mark.parametrize(("told", "heard", "is_behind"), [(3, None, False), (3, 2, True), (3, 3, False), (3, 4, False)])
def test_only_a_program_that_acknowledges_stops_can_be_behind(told: int, heard: int | None, is_behind: bool) -> None:
    stops = HeardStops()
    stops.told, stops.heard = told, heard
    assert stops.is_behind == is_behind


@pytest.mark.parametrize(
    ("packet", "number"),
    [
        (StoppedNotice.heard(0), 0),
        (StoppedNotice.heard(1234), 1234),
        (SendDummyDataRequest(b""), None),
        (SendDummyDataRequest(StoppedNotice.heard(1).data + b" "), None),
        (SendDummyDataRequest(StoppedNotice.heard(1).data + b"2" * 30), None),
        (SendDummyDataRequest(StoppedNotice.heard(1).data[:-1]), None),
        (QueryProjectIDRequest(), None),
    ],
)
def test_the_number_of_a_heard_stop_is_read_as_it_was_written(packet: Packet, number: int | None) -> None:
    assert StoppedNotice.number_heard(packet) == number


async def test_frames_from_before_a_program_heard_of_a_stop_move_nothing_and_later_ones_do() -> None:
    async with shared() as here, here.program("other") as other:
        framed = Framed(here.hub)
        async with here.program("framed", session="both") as control:
            await control.call("board.state")
            framed.send(StoppedNotice.heard(here.hub.stops.count))
            await other.call("stop")
            number = control.of("stopped")[0]["number"]
            framed.send(_START, ExecuteActionExRequest(1), QueryProjectIDRequest())
            await until(lambda: len(framed.packets()) == 2)
            assert not is_started(here, 1)
            assert framed.packets()[0] == SetServoParameterResponse(1, 0, 1)
            assert [notice["reason"] for notice in control.of("refused")] == ["a stop came first"] * 2
            framed.send(
                StoppedNotice.heard(number - 1), _START, StoppedNotice.heard(number), SetServoParameterRequest(2, 1, 1)
            )
            await until(lambda: is_started(here, 2))
            assert not is_started(here, 1)
        framed.program.leave()


async def test_a_program_of_an_earlier_version_acknowledges_nothing_and_moves_as_before() -> None:
    async with shared() as here, here.program("other") as other:
        framed = Framed(here.hub)
        async with here.program("framed", session="both") as control, here.program("page") as page:
            await control.call("board.state")
            await page.call("board.state")
            await other.call("stop")
            framed.send(_START)
            await until(lambda: is_started(here, 1))
            framed.program.leave()
            await page.call("move", targets={"2": 10}, start=True, duration=0.1)
            assert is_started(here, 2)


async def test_the_acknowledgement_of_a_stop_is_no_packet_for_the_board() -> None:
    async with shared() as here:
        framed = Framed(here.hub)
        sent: list[Packet] = []
        here.hub.board.connection.taps.add(Sent(sent))
        framed.send(StoppedNotice.heard(1), SendDummyDataRequest(b"for the board"), QueryProjectIDRequest())
        await until(framed.packets)
        assert SendDummyDataRequest(b"for the board") in sent
        assert StoppedNotice.heard(1) not in sent
        framed.program.leave()


Ask = Callable[[RpcProgram], Awaitable[Any]]

MOTIONS: dict[str, Ask] = {
    "move": lambda page: page.call("move", targets={"1": 40}, duration=0.1),
    "run": lambda page: page.call("run", type="macro", id=1),
    "run.prepare": lambda page: page.call("run.prepare", type="macro", id=1),
    "servo.set": lambda page: page.call("servo.set", servo=1, start=True, hold=True),
}


async def _stream(page: RpcProgram) -> None:
    stream = (await page.call("stream.begin", hz=20))["stream"]
    await page.call("stream.send", stream=stream, targets={"1": 3})


MOTIONS["stream"] = _stream


@pytest.mark.parametrize("motion", MOTIONS)
async def test_messages_from_before_a_program_heard_of_a_stop_move_nothing_and_later_ones_do(motion: str) -> None:
    async with shared() as here, here.program("page") as page, here.program("other") as other:
        await here.hub.board.add_macro(Macro(1, "wave"))
        page.tell("stop.heard", number=here.hub.stops.count)
        await other.call("stop")
        for servo_id in here.virtual.servos:  # so that only the stop is in the way
            await other.call("servo.set", servo=servo_id, start=True, hold=True)
        await other.call("lease.give")
        with pytest.raises(RpcFailed) as refused:
            await MOTIONS[motion](page)
        assert refused.value.kind == "MotionRefused"
        page.tell("stop.heard", number=page.of("stopped")[-1]["number"])
        await MOTIONS[motion](page)


async def test_a_stop_among_dropped_notifications_is_told_again_when_the_program_reads() -> None:
    async with shared() as here, here.program("page") as page:
        page.tell("stop.heard", number=here.hub.stops.count)
        page.channel.pause()
        await here.hub.stop("another one")
        for number in range(300):
            here.hub.tell(ProblemNotice(f"trouble {number}"))
        page.channel.resume()
        number = page.of("stopped")[-1]["number"]
        assert number == here.hub.stops.count
        page.tell("stop.heard", number=number)
        await page.call("move", targets={"1": 10}, start=True, duration=0.1)


def test_the_library_acknowledges_the_stops_of_others_behind_what_it_has_sent() -> None:
    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel) as url, connect(url) as board, connect(url) as other:
            mine = next(each for each in hub.programs.values() if isinstance(each, FrameProgram))
            await other.stop()
            await until(lambda: mine.stops_heard.told == mine.stops_heard.heard == hub.stops.count)
            await board.move({1: 20}, duration=0.05, start=True)
            assert virtual.servos[1].is_start
        await interface.close()

    on_hub(use)
