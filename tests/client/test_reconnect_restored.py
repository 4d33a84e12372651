"""Reconnecting: what is as it was before, and what keeps a board from being taken for the same one.

Module: servolink.client.board_identity.
"""

from __future__ import annotations

import asyncio
import os
from typing import Any

import pytest

from servolink import (
    OpenError,
    TransportUnavailable,
    connect,
    reconnecting,
)
from servolink.client import connecting
from servolink.client.board_identity import SETTLES_AFTER
from servolink.connection import Connection
from servolink.protocol import TransmissionModeSettingRequest, TransmissionModeSettingResponse
from servolink.transports import PortTracker
from servolink.virtual import BoardKind, VirtualBoard
from tests.client.piped_board import LOST, PipedBoard, lie
from tests.client.reconnections import connected, until
from tests.client.sockets import Socket


@pytest.fixture
def socket(monkeypatch: pytest.MonkeyPatch) -> Socket:
    """A socket with a board, which every address leads to."""
    place = Socket(VirtualBoard(servos=3))
    monkeypatch.setattr(connecting, "create", place.transport)
    return place


async def test_a_link_keeps_counting_in_the_same_stats(socket: Socket) -> None:
    async with connected() as board:
        there = socket.board
        assert there is not None
        await board.memory()
        sent = board.stats.frames_sent
        socket.pull()
        socket.plug(there)
        await until(board, "connected")
        assert board.stats.frames_sent > sent
        assert isinstance(board.connection, Connection)


@pytest.mark.virtual_only("the firmware has no old transmission mode")
async def test_the_transmission_mode_is_there_again(socket: Socket) -> None:
    async with connected() as board:
        await board.set_transmission_mode(1)
        socket.pull()
        restarted = VirtualBoard()
        restarted.mode = 0
        socket.plug(restarted)
        await until(board, "connected")
        assert restarted.mode == 1
        assert await board.servo_ids() == tuple(range(1, 17))


@pytest.mark.parametrize("forgets", [False, True])
@pytest.mark.virtual_only("the firmware has no old transmission mode")
async def test_the_old_transmission_mode_is_there_again_on_this_board_only(forgets: bool, socket: Socket) -> None:
    async with connected(patience=0.3) as board:
        ours, other = socket.board, VirtualBoard()
        assert ours is not None
        await board.write_project_id(7)
        await board.servos()  # sets the angle unit, which is to be there again too
        await asyncio.sleep(SETTLES_AFTER)  # sooner lost, it could come back with the id that the other has
        await board.set_transmission_mode(0)
        socket.pull()
        socket.plug(other)
        await asyncio.sleep(20)
        assert (other.mode, board.stats.reconnects) == (1, 0)
        if forgets:
            ours.mode = 1
        socket.plug(ours)
        await until(board, "connected")
        assert ours.mode == 0


async def test_a_board_that_stays_in_another_mode_is_not_connected_to(
    socket: Socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = PipedBoard()
    async with connected(patience=0.3) as board:
        await board.set_transmission_mode(1)
        monkeypatch.setattr(connecting, "create", lambda _: fake)
        fake.plan(TransmissionModeSettingRequest, lie(TransmissionModeSettingResponse(0)))
        socket.pull()
        await asyncio.sleep(10)
        assert board.stats.reconnects == 0
        assert len(fake.executed_of(TransmissionModeSettingRequest)) == 1
        assert fake.closed


async def test_closing_while_the_session_is_being_restored_frees_the_port(socket: Socket) -> None:
    board = await connect("virtual://", reconnect=True)
    silent = VirtualBoard()
    silent.mode = 0
    socket.pull()
    socket.plug(silent)
    await asyncio.sleep(0.5)
    assert len(silent.sessions) == 1
    await board.close()
    assert silent.sessions == []
    assert socket.live == []


async def test_a_board_that_falls_silent_behind_its_opening_is_not_connected_to(
    socket: Socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = PipedBoard()

    async def learn(_: PortTracker) -> None:
        fake.usual = LOST

    monkeypatch.setattr(PortTracker, "learn", learn)
    monkeypatch.setattr(connecting, "create", lambda _: fake)
    with pytest.raises(OpenError, match="was not answered") as caught:
        await connect("virtual://", reconnect=True)
    assert caught.value.__suppress_context__  # the traceback of the request adds nothing
    assert fake.closed == 1


@pytest.mark.parametrize("seed", [0, 23])  # the opening of the second does not ask for the id
async def test_a_board_without_project_id_is_connected_to_again_after_a_loss(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "urandom", lambda size: bytes([seed] * size))
    virtual = VirtualBoard(2, kind=BoardKind(unsupported=("QueryProjectID",)))
    socket = Socket(virtual)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True) as board:
        assert board.unanswered == {"QueryProjectID"}
        socket.pull()
        socket.plug(virtual)
        await until(board, "connected")
        assert await board.servo_ids() == (1, 2)
        assert not await board.has_unfinished_import()


async def test_who_is_cancelled_while_connecting_leaves_nothing_open(
    socket: Socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def learn(_: PortTracker) -> None:
        await asyncio.sleep(1)

    monkeypatch.setattr(PortTracker, "learn", learn)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.5):
            await connect("virtual://", reconnect=True)
    assert socket.opened == 1
    assert socket.live == []


@pytest.mark.parametrize("broken", ["opening", "restoring"])
async def test_no_failure_of_a_library_ends_the_tries(
    broken: str, socket: Socket, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    failures = [TypeError("int() can't convert non-string with explicit base")]

    async def fail_once(*_: object) -> Any:
        if failures:
            raise failures.pop()
        return "virtual://"

    async with connected() as board:
        there = socket.board
        assert there is not None
        if broken == "opening":
            monkeypatch.setattr(PortTracker, "url", fail_once)
        else:
            board._session.restore_with(fail_once)
        socket.pull()
        socket.plug(there)
        await until(board, "connected")
        assert len(there.sessions) == 1
    assert "unexpected error while reconnecting" in caplog.text


async def test_no_waiting_makes_a_wrong_address_right() -> None:
    with pytest.raises(TransportUnavailable, match="unknown kind of address"):
        async for _ in reconnecting("carrier-pigeon://coop"):
            pass
