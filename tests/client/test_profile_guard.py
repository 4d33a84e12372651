"""A profile guards its board: another one in its place is not moved or written.

Module: servolink.client.identity_guard.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from servolink import Action, Board, Macro, MacroCommand, Step, connect
from servolink.boards import Alias, Aliases, BoardIdentityRecord, BoardProfile, BoardSettings, ProfileFile
from servolink.client import connecting
from servolink.errors import (
    RequestError,
    RequestTimeout,
    WrongBoard,
)
from servolink.protocol import (
    ACTION,
    MACRO,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    SetServoParameterRequest,
)
from servolink.transports import PortIdentity
from servolink.virtual import VirtualBoard, serve
from tests.client.piped_board import LOST, PipedBoard, lie, opened, turns_of_the_loop
from tests.client.sockets import Socket
from tests.virtual_time import run


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def use(name: str, url: str, profile: BoardProfile) -> None:
    Aliases.save(name, Alias(url))
    ProfileFile(name).save(profile)


# --- another board ----------------------------------------------------------------------------------------------------

MEMORY = VirtualBoard().storage.memory
REX = BoardProfile(identity=BoardIdentityRecord(servo_ids=(4, 2, 1, 3), memory_total=MEMORY))
MOVES = (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest)

Deed = Callable[[Board], Awaitable[object]]
GUARDED: dict[str, Deed] = {
    "move": lambda board: board.move({1: 5}, duration=1),
    "run_action": lambda board: board.run_action(1),
    "run_macro": lambda board: board.run_macro(2),
    "start": lambda board: board.set_servo(1, start=True, hold=True),
    "add_action": lambda board: board.add_action(Action(7, "", (Step(1, 0, 1),))),
    "delete_action": lambda board: board.delete_action(1),
    "delete_macro": lambda board: board.delete_macro(2),
    "clear": lambda board: board.clear_all_data(),
    "write": lambda board: board.write_project_id(8),
    "request": lambda board: board.request(ExecuteMacroRequest(2)),
    "send": lambda board: board.send(ExecuteActionExRequest(1)),
    "table": lambda board: board.set_active_joystick_table(0),
    "servos": lambda board: board.add_servo_parameters(()),
}
FREE: dict[str, Deed] = {
    "stop": lambda board: board.stop(),
    "release": lambda board: board.release(),
    "hold": lambda board: board.set_servo(1, start=False, hold=True),
    "servos": lambda board: board.servos(),
    "unit": lambda board: board.set_angle_unit("adc"),
    "dummy": lambda board: board.send_dummy_data(b"x"),
    "action": lambda board: board.action(1),
    "export": lambda board: board.export_project(),
}


def other_board() -> PipedBoard:
    """Return a board with other servos than rex, on which something is stored."""
    fake = PipedBoard(servos=5)
    fake.storage.project_id = 3
    return fake


def store(fake: PipedBoard) -> None:
    for packet in (
        ACTION.add(Action(1, "Bow", (Step(1, 5, 10),))),
        MACRO.add(Macro(2, "Dance", (MacroCommand.of(0.1),))),
    ):
        fake._session.receive(fake.codec.encode(packet), 0.0)


@pytest.mark.parametrize("name", GUARDED)
def test_another_board_is_neither_moved_nor_changed(name: str, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        fake = other_board()
        store(fake)
        before = fake.storage.free
        async with opened(fake, profile=REX) as board:
            with pytest.raises(WrongBoard) as refused:
                await GUARDED[name](board)
            assert str(refused.value).startswith(
                f"the board of the profile was learnt with servos 1..4, memory total {MEMORY}; the board at "
                f"fake://board has servos 1..5, memory total {MEMORY}: "
            )
            with pytest.raises(WrongBoard):
                await GUARDED[name](board)
        assert not [packet for packet in fake.executed if isinstance(packet[1], MOVES)]
        assert fake.storage.free == before
        assert fake.storage.project_id == 3

    run(main())
    assert caplog.messages.count(caplog.messages[0]) == 1
    assert "it can be read, but neither moved nor changed" in caplog.messages[0]
    assert caplog.records[0].levelno == logging.WARNING


@pytest.mark.parametrize("name", FREE)
async def test_another_board_can_be_stopped_released_and_read(name: str) -> None:
    fake = other_board()
    store(fake)
    async with opened(fake, profile=REX) as board:
        before = len(fake.executed)
        await FREE[name](board)
        assert len(fake.executed) > before


async def test_a_stop_does_not_wait_for_the_check() -> None:
    fake = PipedBoard()
    fake.usual_of[QueryServoListRequest] = LOST
    async with connect(fake, profile=REX, handshake=False) as board:
        moving = asyncio.create_task(board.move({1: 5}, duration=1))
        await asyncio.sleep(1)
        await board.stop()
        with pytest.raises((RequestTimeout, RequestError)):
            await moving
    assert not fake.executed_of(ExecuteActionRequest)
    assert fake.executed_of(SetServoParameterRequest)


async def test_a_macro_asked_for_before_a_stop_is_not_started_after_it() -> None:
    fake = PipedBoard()
    store(fake)
    async with opened(fake, profile=REX, handshake=False) as board:
        starting = asyncio.create_task(board.run_macro(2))
        await turns_of_the_loop(3)
        await board.stop()
        with pytest.raises(RequestError, match="a stop came first"):
            await starting
    assert not fake.executed_of(ExecuteMacroRequest)


async def test_the_right_board_is_asked_once_for_each_connection() -> None:
    fake = PipedBoard()
    store(fake)
    async with connect(fake, profile=REX) as board:
        assert len(fake.sent_of(QueryServoListRequest)) == 1
        await board.servos()  # counted against the list
        await asyncio.gather(board.move({1: 5}, duration=1), board.run_action(1), board.write_project_id(8))
    assert len(fake.sent_of(QueryServoListRequest)) == 2
    assert fake.executed_of(ExecuteActionRequest)


async def test_without_a_handshake_the_board_is_checked_before_it_moves() -> None:
    fake = PipedBoard()
    async with connect(fake, profile=REX, handshake=False) as board:
        await board.servos()
        fake.plan(QueryServoListRequest, lie(QueryServoListResponse((9,))))
        with pytest.raises(WrongBoard):
            await board.move({1: 5}, duration=1)
        await board.move({1: 5}, duration=1)  # it was a damaged response, perhaps: now it is right
        assert fake.executed_of(ExecuteActionRequest)


async def test_a_check_that_is_not_answered_refuses_too() -> None:
    fake = PipedBoard()
    fake.usual_of[QueryServoListRequest] = LOST
    async with opened(fake, profile=REX, handshake=False) as board:
        with pytest.raises(RequestTimeout, match="QueryServoList"):
            await board.move({1: 5}, duration=1)
        with pytest.raises(RequestTimeout, match="ExecuteMacro"):
            await board.request(ExecuteMacroRequest(2), timeout=0.2)
    assert not fake.executed_of(ExecuteActionRequest)


@pytest.mark.parametrize(
    ("identity", "is_same"),
    [
        (BoardIdentityRecord(), True),
        (BoardIdentityRecord(servo_ids=(1, 2, 3, 4)), True),
        (BoardIdentityRecord(servo_ids=(1, 2, 3)), False),
        (BoardIdentityRecord(servo_ids=()), False),
        (BoardIdentityRecord(memory_total=MEMORY), True),
        (BoardIdentityRecord(memory_total=MEMORY // 2), False),
        (BoardIdentityRecord(vendor_id=1, product_id=2, serial_number="A1"), True),
        (BoardIdentityRecord(vendor_id=1, product_id=2), True),
        (BoardIdentityRecord(vendor_id=3), False),
        (BoardIdentityRecord(serial_number="B\x1b2"), False),
    ],
)
async def test_a_board_differs_by_what_is_known_of_both(
    identity: BoardIdentityRecord, is_same: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servolink.client.identity_guard.identity_of", lambda url: PortIdentity(1, 2, "A1"))
    async with connect(PipedBoard(), profile=BoardProfile(identity=identity)) as board:
        if is_same:
            await board.move({1: 5}, duration=1)
        else:
            with pytest.raises(WrongBoard) as refused:
                await board.move({1: 5}, duration=1)
            assert "\x1b" not in str(refused.value)


async def test_what_the_board_does_not_report_is_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servolink.client.identity_guard.identity_of", lambda url: None)
    identity = BoardIdentityRecord(servo_ids=(1,), memory_total=5, serial_number="A1")
    settings = BoardSettings(unsupported=("QueryServoList",))
    fake = PipedBoard()
    fake.usual_of[QueryMemorySizeRequest] = lie(QueryMemorySizeResponse(100))
    async with connect(fake, profile=BoardProfile(identity=identity, settings=settings)) as board:
        await board.move({1: 5}, duration=1)
    assert not fake.sent_of(QueryServoListRequest)


def test_another_board_served_in_the_place_of_rex_is_refused() -> None:
    async def main() -> None:
        board, place = VirtualBoard(4), "127.0.0.1:0"
        use("rex", "tcp://127.0.0.1:1", REX)
        for servos in (4, 5):
            board = VirtualBoard(servos)
            async with serve(board, tcp=place) as (url,):
                place = url.removeprefix("tcp://")
                Aliases.save("rex", Alias(url))
                async with connect("rex") as rex:
                    if servos == 4:
                        await rex.move({1: 5}, duration=0.01)
                        continue
                    before = board.storage.used
                    for deed in (rex.move({1: 5}, duration=0.01), rex.clear_all_data(), rex.write_project_id(5)):
                        with pytest.raises(WrongBoard, match=r"learnt with servos 1\.\.4, .* has servos 1\.\.5, "):
                            await deed
                    assert (board.storage.used, board.storage.project_id) == (before, 0)
                    await rex.stop()
                    assert len(await rex.servos()) == 5

    asyncio.run(main())


async def test_the_memory_is_in_bytes_whatever_the_board_counts_in() -> None:
    fake = PipedBoard()
    fake.usual_of[QueryMemorySizeRequest] = lie(QueryMemorySizeResponse(30, 64))
    for settings, size in (
        (BoardSettings(), 30),
        (BoardSettings(memory_unit=1), 30),
        (BoardSettings(memory_unit=1024), 30 * 1024),
    ):
        async with connect(fake, profile=BoardProfile(settings=settings)) as board:
            assert (await board.memory()).size == size
            assert (await board.memory()).total_size == size // 30 * 64
        fake.gone = None
    fake.usual_of[QueryMemorySizeRequest] = lie(QueryMemorySizeResponse(30))
    async with connect(fake, profile=BoardProfile(settings=BoardSettings(memory_unit=1024))) as board:
        assert await board.memory() == QueryMemorySizeResponse(30 * 1024)


async def test_another_board_that_comes_back_under_the_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, other = VirtualBoard(4), VirtualBoard(6)  # with the same project id
    socket = Socket(ours)
    monkeypatch.setattr(connecting, "create", socket.transport)
    use("rex", "virtual://", REX)
    async with connect("rex", reconnect=True) as board:
        await board.move({1: 5}, duration=1)
        socket.pull()
        socket.plug(other)
        await asyncio.sleep(5)
        assert board.stats.reconnects == 1
        assert len(await board.servos()) == 6
        with pytest.raises(WrongBoard, match=r"learn it again: servolink doctor rex --learn; else .* servolink use"):
            await board.move({1: 5}, duration=1)
        socket.pull()
        socket.plug(ours)
        await asyncio.sleep(5)
        await board.move({1: 5}, duration=1)
