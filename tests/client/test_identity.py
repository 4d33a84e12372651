"""Which board is taken for the one that was lost, whatever was done to its project id before."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest

from servolink import Board, ConnectionLost, EncodeError, NotFound, OutcomeUnknown, Rejected, connect
from servolink.client import connecting
from servolink.protocol import QueryProjectIDRequest, WriteProjectIDRequest, WriteProjectIDResponse
from servolink.virtual import BoardKind, Clear, VirtualBoard
from tests.client.piped_board import PipedBoard, late, lie, opened, turns_of_the_loop
from tests.client.sockets import Socket

Deed = Callable[[Board, Socket], Awaitable[None]]


async def ask_the_impossible(board: Board, socket: Socket) -> None:
    with pytest.raises(EncodeError):
        await board.write_project_id(2**40)


async def write(board: Board, socket: Socket) -> None:
    await board.write_project_id(6)


async def clear(board: Board, socket: Socket) -> None:
    await board.clear_all_data()


async def cancel_before_the_answer(board: Board, socket: Socket) -> None:
    writing = asyncio.create_task(board.write_project_id(6))
    await asyncio.sleep(0)
    writing.cancel()
    await asyncio.wait([writing])


async def write_in_vain(board: Board, socket: Socket) -> None:
    assert socket.board is not None
    socket.board.mode = 0  # answers nothing, does nothing
    with pytest.raises(OutcomeUnknown):
        await board.write_project_id(6)
    socket.board.mode = 1


async def clear_in_vain(board: Board, socket: Socket) -> None:
    assert socket.board is not None
    socket.board.mode = 0
    with pytest.raises(OutcomeUnknown):
        await board.clear_all_data()
    socket.board.mode = 1


async def write_when_it_is_lost(board: Board, socket: Socket) -> None:
    socket.pull()
    with pytest.raises(ConnectionLost):
        await board.write_project_id(77)


DEEDS: list[Deed] = [
    ask_the_impossible,
    write,
    clear,
    cancel_before_the_answer,
    write_in_vain,
    clear_in_vain,
    write_when_it_is_lost,
]


@pytest.mark.parametrize("keeps", ["all", "records"])
@pytest.mark.parametrize("deed", DEEDS)
async def test_another_board_is_never_taken_for_ours_and_ours_always_is(
    deed: Deed, keeps: Clear, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ours, other = VirtualBoard(kind=BoardKind(clear=keeps)), VirtualBoard()
    ours.storage.project_id, other.storage.project_id = 5, 77
    socket = Socket(ours)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True) as board:
        await deed(board, socket)
        socket.pull()
        socket.plug(other)
        await asyncio.sleep(20)
        assert board.stats.reconnects == 0
        assert other.sessions == []
        (said,) = [record.message for record in caplog.records if record.levelname == "WARNING"]
        assert re.search(r"the board at virtual:// has project id 77, not .*, so it is another one", said)
        socket.plug(ours)
        await asyncio.sleep(20)
        assert board.stats.reconnects == 1


async def test_which_board_it_is_is_learnt_when_it_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it might have become for all that was known does not stand for it any longer."""
    ours, other = VirtualBoard(), VirtualBoard()
    ours.storage.project_id, other.storage.project_id = 5, 6
    socket = Socket(ours)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True) as board:
        await write_in_vain(board, socket)
        socket.pull()
        socket.plug(ours)
        await asyncio.sleep(5)
        assert board.stats.reconnects == 1
        socket.pull()
        socket.plug(other)
        await asyncio.sleep(20)
        assert board.stats.reconnects == 1


async def test_a_new_board_is_not_taken_for_a_cleared_one_that_keeps_its_id(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, new = VirtualBoard(kind=BoardKind(clear="records")), VirtualBoard()
    ours.storage.project_id = 5
    socket = Socket(ours)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True) as board:
        await board.clear_all_data()
        socket.pull()
        socket.plug(new)
        await asyncio.sleep(20)
        assert board.stats.reconnects == 0


async def test_a_board_that_is_lost_right_after_clearing_has_been_cleared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours = VirtualBoard()
    ours.storage.project_id = 5
    socket = Socket(ours)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True) as board:
        clearing = asyncio.create_task(board.clear_all_data())
        with suppress(TimeoutError):
            async with asyncio.timeout(60):
                while ours.storage.project_id:
                    await asyncio.sleep(0)
        while not clearing.done() and not board._session.identity._project_ids >= {0, 5}:
            await asyncio.sleep(0)
        socket.pull()
        await clearing
        socket.plug(ours)
        await asyncio.sleep(5)
        assert board.stats.reconnects == 1
        assert await board.project_id() == 0


@pytest.mark.parametrize("is_cleared", [False, True])
@pytest.mark.parametrize(("seconds", "reconnects"), [(0.3, 1), (60, 0)])
async def test_a_board_may_lose_power_before_it_has_stored_its_new_id(
    seconds: float, reconnects: int, is_cleared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = VirtualBoard()
    ours.storage.project_id = 5
    socket = Socket(ours)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True) as board:
        await (board.clear_all_data() if is_cleared else board.write_project_id(6))
        assert await board.project_id() == (0 if is_cleared else 6)
        await asyncio.sleep(seconds)
        socket.pull()
        ours.storage.project_id = 5
        socket.plug(ours)
        await asyncio.sleep(20)
        assert board.stats.reconnects == reconnects  # later it is another board, with the id that ours had once


async def test_a_board_that_refuses_an_id_has_the_one_it_had() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.project_id()
        fake.plan(WriteProjectIDRequest, lie(WriteProjectIDResponse(0)))
        with pytest.raises(Rejected):
            await board.write_project_id(6)
        fake.storage.project_id = 6
        with pytest.raises(NotFound, match="project id 6, not 0"):
            await board._session.identity.check(board._session.connection)


async def test_an_answer_from_before_a_write_that_was_given_up_does_not_say_what_the_board_has() -> None:
    fake = PipedBoard()
    fake.plan(QueryProjectIDRequest, late(0), late(0.5))
    async with opened(fake, depth=2, patience=6) as board:
        await board.write_project_id(5)
        assert await board.project_id() == 5
        asking = asyncio.create_task(board.project_id())
        await turns_of_the_loop(2)
        writing = asyncio.create_task(board.write_project_id(6))
        await turns_of_the_loop(2)
        writing.cancel()
        assert await asking == 5
        await board._session.identity.check(board._session.connection)  # it has 6, and is still ours
        board._session.identity.set(9)
        with pytest.raises(NotFound, match="has project id 6, not 9"):
            await board._session.identity.check(board._session.connection)
