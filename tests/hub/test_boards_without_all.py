"""Hubs of boards that ignore requests for all servos, and of boards that do not.

Modules: servolink.hub.engine.stop_order, servolink.client.all_servos.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager

import pytest

from servolink.boards import BoardIdentityRecord, BoardProfile, BoardSettings
from servolink.client import Board, connect
from servolink.control import Greeting
from servolink.hub.hub import Hub, share
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol import ALL_SERVOS, Codec, SetServoParameterRequest
from servolink.virtual import BoardTransport
from tests.hub.control_program import RpcProgram
from tests.hub.local_transport import LocalTransport
from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.kinds import KINDS

LEARNT = BoardProfile(
    settings=BoardSettings(unsupported=("QueryServo",)), identity=BoardIdentityRecord(servo_ids=(1, 2, 3, 4))
)
FLAGS = SetServoParameterRequest.packet_id
STOPPED, RELEASED, READY = (0, 1), (0, 0), (1, 1)

Stop = Callable[["There"], Awaitable[object]]


class There:
    """A hub on an odd board, with a program of each kind."""

    def __init__(self, hub: Hub, board: OddBoard, program: Board, page: RpcProgram) -> None:
        self.hub, self.program, self.page = hub, program, page
        self.sent: list[tuple[float, tuple[int, ...]]] = []
        """Packets for start and hold that the board got, with their times."""
        self._board, self._take = board, board.take
        vars(board)["take"] = self._hear

    def _hear(self, line: OddLine, packet_id: int, content: bytes) -> None:
        if packet_id == FLAGS:
            self.sent.append((asyncio.get_running_loop().time(), tuple(content)))
        self._take(line, packet_id, content)

    @property
    def states(self) -> set[tuple[int, int]]:
        """Return the different pairs of start and hold."""
        return {(servo.is_start, servo.is_hold) for servo in self._board.servos.values()}


@asynccontextmanager
async def on_hub(kind: str, profile: BoardProfile | None = None) -> AsyncIterator[There]:
    board = KINDS[kind]()
    async with (
        connect(BoardTransport(board, "virtual://"), angle_unit=None, profile=profile) as upstream,
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub, codec=Codec())) as program,
    ):
        interface = ControlInterface(hub)
        page = RpcProgram(hub, interface, Greeting(wants="rpc", who="page"))
        yield There(hub, board, program, page)
        await page.channel.close()
        await interface.close()


async def by_program(there: There) -> None:
    await there.program.stop()


async def by_page(there: There) -> None:
    await there.page.call("stop")


async def by_hub(there: There) -> None:
    await there.hub.stop("the button")


async def by_dead_man(there: There) -> None:
    await there.page.call("lease.take", dead_man=0.3)
    await there.page.until("lease", 2)
    await asyncio.sleep(0.1)


STOPS: tuple[Stop, ...] = (by_program, by_page, by_hub, by_dead_man)


@pytest.mark.parametrize("stop", STOPS)
async def test_a_stop_goes_to_all_servos_and_at_once_to_each_of_a_learnt_board(stop: Stop) -> None:
    async with on_hub("no-all", LEARNT) as there:
        await stop(there)
        assert there.states == {STOPPED}
        packets = [packet for _, packet in there.sent]
        assert packets[:5] == [(servo_id, *STOPPED) for servo_id in (ALL_SERVOS, 1, 2, 3, 4)]
        assert len({time for time, _ in there.sent[:5]}) == 1


@pytest.mark.parametrize("stop", STOPS)
async def test_a_stop_goes_to_each_servo_of_a_board_that_was_not_learnt(stop: Stop) -> None:
    async with on_hub("no-all") as there:
        begun = asyncio.get_running_loop().time()
        await stop(there)
        await asyncio.sleep(begun + 2 - asyncio.get_running_loop().time())
        assert there.states == {STOPPED}
        assert there.sent[0][1] == (ALL_SERVOS, *STOPPED)


@pytest.mark.parametrize("stop", [by_page, by_hub, by_dead_man])
@pytest.mark.parametrize("profile", [None, BoardProfile()])
async def test_a_stop_is_one_packet_on_a_board_that_answers_for_all(stop: Stop, profile: BoardProfile | None) -> None:
    async with on_hub("plain", profile) as there:
        await stop(there)
        await asyncio.sleep(1)
        assert there.states == {STOPPED}
        assert [packet for _, packet in there.sent] == [(ALL_SERVOS, *STOPPED)]


@pytest.mark.parametrize("profile", [None, LEARNT])
async def test_programs_with_frames_move_read_stop_start_and_release_all_servos(profile: BoardProfile | None) -> None:
    async with on_hub("no-all", profile) as there:
        await there.program.move({1: 30, 4: -30}, duration=0.1, wait=True)
        assert [servo.angle for servo in await there.program.servos()] == [30, 0, 0, -30]
        await there.program.stop()
        assert there.states == {STOPPED}
        await there.program.set_servo(ALL_SERVOS, start=True, hold=True)
        assert there.states == {READY}
        await there.program.release()
        assert there.states == {RELEASED}


@pytest.mark.parametrize("profile", [None, LEARNT])
async def test_pages_move_end_their_movements_and_release_all_servos(profile: BoardProfile | None) -> None:
    async with on_hub("no-all", profile) as there:
        await there.page.call("move", targets={"1": 90}, duration=10)
        for servos in ([1, 2], None):
            there.sent.clear()
            await there.page.call("move.end", servos=servos)
            assert there.states == {READY}
            stopped = {packet[0] for _, packet in there.sent if packet[1:] == STOPPED}
            assert stopped == set(servos or (ALL_SERVOS, 1, 2, 3, 4))
        await there.page.call("release", servo="all")
        assert there.states == {RELEASED}


async def test_a_release_without_any_angle_before_goes_to_each_servo() -> None:
    async with on_hub("no-all") as there:
        await there.page.call("release", servo="all")
        assert there.states == {RELEASED}


async def test_a_lease_ends_when_the_servos_of_the_board_rest() -> None:
    async with on_hub("no-all", LEARNT) as there:
        await there.page.call("servo.set", servo=1, start=True, hold=True)
        assert there.hub.lease is not None
        await asyncio.sleep(60)
        assert there.hub.lease is None
