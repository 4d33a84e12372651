"""Reconnecting: a board that is unplugged and comes back.

Module: servolink.client.session.
"""

from __future__ import annotations

import asyncio
import gc
import mmap
from contextlib import aclosing, suppress
from pathlib import Path

import pytest

from servolink import (
    Adc,
    Board,
    ConnectionLost,
    Degrees,
    connect,
    reconnecting,
)
from servolink.client import connecting
from servolink.support import LONGEST_PAUSE
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.client.reconnections import connected, until
from tests.client.sockets import Socket


@pytest.fixture
def socket(monkeypatch: pytest.MonkeyPatch) -> Socket:
    """A socket with a board, which every address leads to."""
    place = Socket(VirtualBoard(servos=3))
    monkeypatch.setattr(connecting, "create", place.transport)
    return place


async def test_the_same_board_comes_back_and_answers(socket: Socket) -> None:
    async with connected() as board:
        await board.write_project_id(7)
        there = socket.board
        assert there is not None
        socket.pull()
        await until(board, "lost")
        with pytest.raises(ConnectionLost, match="unplugged"):
            await board.servos()
        await asyncio.sleep(20)
        socket.plug(there)
        await until(board, "connected")
        assert await board.project_id() == 7
        assert board.stats.reconnects == 1


async def test_what_waited_fails_at_once_with_the_first_cause(socket: Socket) -> None:
    loop = asyncio.get_running_loop()
    async with connected() as board:
        waiting = [asyncio.ensure_future(board.memory()) for _ in range(5)]
        await asyncio.sleep(0)
        before = loop.time()
        socket.pull()
        for failed in await asyncio.gather(*waiting, return_exceptions=True):
            assert isinstance(failed, ConnectionLost)
            assert "unplugged" in str(failed.__cause__)
        assert loop.time() == before


async def test_units_and_events_are_there_again_and_motion_is_not(socket: Socket) -> None:
    async with connected() as board:
        await board.set_angle_unit("adc", 2)
        await board.move({1: 90, 2: Adc(2048)}, duration=5)
        events = board.button_events()
        async with events:
            await asyncio.sleep(1)
            socket.pull()
            fresh = VirtualBoard(servos=3, seed=5)  # restarted: it has forgotten everything
            socket.plug(fresh)
            await until(board, "connected")
            angles = [servo.angle for servo in await board.servos()]
            assert [type(angle) for angle in angles] == [Degrees, Adc, Degrees]
            fresh.press_button(4, asyncio.get_running_loop().time())
            event = await anext(events)
            assert (event.button_id, event.kind) == (4, "press")
            await asyncio.sleep(10)
            assert [servo.angle for servo in await board.servos()] == angles


async def test_a_reader_that_comes_while_the_board_is_away_may_try_again(socket: Socket) -> None:
    async with connected() as board:
        there = socket.board
        assert there is not None
        socket.pull()
        events = board.button_events()
        for _ in range(2):
            with pytest.raises(ConnectionLost, match="unplugged"):
                await anext(events)
        socket.plug(there)
        await until(board, "connected")
        async with events:
            there.press_button(4, asyncio.get_running_loop().time())
            assert (await anext(events)).button_id == 4


async def test_another_board_is_not_taken_for_it(socket: Socket) -> None:
    async with connected() as board:
        await board.write_project_id(7)
        ours, other = socket.board, VirtualBoard()
        assert ours is not None
        other.storage.project_id = 8
        socket.pull()
        socket.plug(other)
        await asyncio.sleep(60)
        assert board.stats.reconnects == 0
        assert other.sessions == []
        socket.plug(ours)
        await until(board, "connected")
        assert await board.project_id() == 7


async def test_a_board_that_was_cleared_is_still_the_same(socket: Socket) -> None:
    async with connected() as board:
        await board.write_project_id(7)
        await board.clear_all_data()
        there = socket.board
        assert there is not None
        socket.pull()
        socket.plug(there)
        await until(board, "connected")
        assert await board.project_id() == 0


async def test_the_pauses_grow_from_a_tenth_of_a_second_to_five(socket: Socket) -> None:
    loop = asyncio.get_running_loop()
    async with connected() as board:
        socket.pull()
        await until(board, "lost")
        tries: list[float] = []
        lost_at, before = loop.time(), socket.opened
        while len(tries) < 9:
            await asyncio.sleep(0.01)
            if socket.opened > before:
                before = socket.opened
                tries.append(loop.time() - lost_at)
        pauses = [later - earlier for earlier, later in zip([0.0, *tries], tries, strict=False)]
        assert pauses[:3] == pytest.approx([0.1, 0.2, 0.4], abs=0.02)
        assert pauses[-2:] == pytest.approx([LONGEST_PAUSE, LONGEST_PAUSE], abs=0.02)


async def test_states_are_seen_by_every_reader_up_to_the_end(socket: Socket) -> None:
    async def watch(board: Board) -> list[str]:
        return [state async for state in board.states()]

    async with connected() as board:
        readers = [asyncio.create_task(watch(board)) for _ in range(2)]
        there = socket.board
        assert there is not None
        await asyncio.sleep(1)
        socket.pull()
        await asyncio.sleep(1)
        socket.plug(there)
        await until(board, "connected")
    for seen in await asyncio.gather(*readers):
        assert seen == ["connected", "lost", "connected", "closed"]


async def test_closing_while_lost_ends_the_tries_and_the_events(socket: Socket) -> None:
    board = await connect("virtual://", reconnect=True)
    events = board.button_events()
    async with events:
        socket.pull()
        await asyncio.sleep(3)
        await board.close()
        tried = socket.opened
        assert [event async for event in events] == []
    await asyncio.sleep(60)
    assert socket.opened == tried


async def test_a_board_that_falls_silent_while_it_comes_back_is_tried_again(socket: Socket) -> None:
    async with connected(patience=0.3, transmission_mode="keep") as board:
        there = socket.board
        assert there is not None
        socket.pull()
        there.mode = 0  # answers nothing
        socket.plug(there)
        await asyncio.sleep(5)
        assert board.stats.reconnects == 0
        there.mode = 1
        await until(board, "connected")


async def test_without_reconnect_a_loss_is_the_end(socket: Socket) -> None:
    async with connect("virtual://") as board:
        events = board.button_events()
        async with events:
            socket.pull()
            await until(board, "lost")
            with pytest.raises(ConnectionLost, match="unplugged"):
                await anext(events)
        tried = socket.opened
        await asyncio.sleep(60)
        assert socket.opened == tried


def test_a_transport_cannot_be_opened_twice_so_reconnect_needs_an_address() -> None:
    with pytest.raises(ValueError, match="give an address"):
        connect(VirtualTransport(VirtualBoard()), reconnect=True)


def resident() -> int:
    """Return the bytes of memory that this process uses; 0 where the system does not tell it so."""
    gc.collect()
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * mmap.PAGESIZE if statm.exists() else 0


@pytest.mark.parametrize("losses", [200, pytest.param(1000, marks=pytest.mark.slow)])
async def test_many_losses_leave_nothing_behind_and_no_wrong_answer(losses: int, socket: Socket) -> None:
    there = socket.board
    assert there is not None
    async with connected() as board:
        await board.write_project_id(7)
        async with board.button_events():
            used = 0
            for turn in range(losses):
                if turn == losses * 3 // 10:  # whatever is loaded or cached is there by now
                    used = resident()
                asked = asyncio.ensure_future(board.project_id() if turn % 2 else board.servo_ids())
                if turn % 3:
                    await asyncio.sleep(0)
                socket.pull()
                with suppress(ConnectionLost):
                    assert await asked in (7, (1, 2, 3))
                socket.plug(there)
                await until(board, "connected")
                assert len(asyncio.all_tasks()) <= 2
                assert len(there.sessions) == 1
        assert board.stats.reconnects == losses
        assert await board.project_id() == 7
        assert resident() - used < 2 << 20


async def test_reconnecting_yields_a_board_for_each_connection(socket: Socket) -> None:
    there = socket.board
    assert there is not None
    boards = []
    async with aclosing(reconnecting("virtual://")) as connections:
        async for board in connections:
            boards.append(board)
            try:
                await board.memory()
                if len(boards) == 3:
                    break
                socket.pull()
                asyncio.get_running_loop().call_later(7, socket.plug, there)
                await board.memory()
            except ConnectionLost:
                continue
    assert len({id(board) for board in boards}) == 3


@pytest.mark.parametrize(("answers", "least", "most"), [(False, 15, 20), (True, 500, 700)])
async def test_reconnecting_waits_longer_until_a_board_has_answered(
    answers: bool, least: int, most: int, socket: Socket
) -> None:
    there = socket.board
    assert there is not None
    with suppress(TimeoutError):
        async with asyncio.timeout(60), aclosing(reconnecting("virtual://")) as connections:
            async for board in connections:
                if answers:
                    await board.memory()
                socket.pull()
                socket.plug(there)
    assert least < socket.opened < most


async def test_reconnecting_needs_an_address() -> None:
    with pytest.raises(ValueError, match="reconnecting: a transport can be opened only once; give an address"):
        await anext(reconnecting(VirtualTransport(VirtualBoard())))  # type: ignore[arg-type]
