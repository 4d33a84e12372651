"""`virtual://`: a board on the running loop, in virtual time."""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from servolink.client import connect
from servolink.errors import ConnectionLost, OpenError, TransportUnavailable
from servolink.protocol import (
    MACRO,
    AddMacroRequest,
    AddMacroResponse,
    ButtonEventResponse,
    ClearAllDataRequest,
    Codec,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroCommand,
    Packet,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    Step,
    SubscribeButtonEventRequest,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.transports import Address
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind
from servolink.virtual.state_file import load_state
from servolink.virtual.transport import BoardTransport, FaultyVirtualTransport, VirtualTransport, from_address
from tests.client.reconnections import until
from tests.lab.odd.kinds import KINDS
from tests.virtual.receiving import Heard, ask
from tests.virtual_time import run

LIST = Codec().encode(QueryServoListRequest())
MOVE = Codec().encode(ExecuteActionRequest((Step(1, 90, 100),)))  # takes 1 s


def made(url: str) -> BoardTransport[Any] | FaultyVirtualTransport:
    return from_address(Address.parse(url))


async def test_it_answers_in_a_later_turn_of_the_loop() -> None:
    transport, heard = VirtualTransport(VirtualBoard(servos=2)), Heard()
    await transport.open(heard)
    await transport.send(LIST + LIST)
    assert heard.packets == []
    assert await heard.until(2) == [QueryServoListResponse((1, 2))] * 2
    await transport.close()


async def test_the_board_receives_what_was_sent_in_a_later_turn_of_the_loop_as_of_the_sending() -> None:
    board, moment = VirtualBoard(servos=1), asyncio.get_running_loop().time()
    transport = VirtualTransport(board)
    await transport.open(Heard())
    await transport.send(MOVE)
    sent_by = asyncio.get_running_loop().time()
    moving = [board.servos[1].moving]
    await asyncio.sleep(0)
    moving.append(board.servos[1].moving)
    for time in (moment + 0.9, sent_by + 1.0):
        board.advance(time)
        moving.append(board.servos[1].moving)
    assert moving == [False, True, True, False]
    await transport.close()


async def test_what_was_sent_right_before_the_end_reaches_the_board() -> None:
    board = VirtualBoard(servos=1)
    transport = VirtualTransport(board)
    await transport.open(Heard())
    await transport.send(MOVE)
    await transport.close()
    assert board.servos[1].moving


def test_the_address_makes_the_board() -> None:
    transport = made("virtual://?servos=3&seed=4&memory=1000&byte_order=big")
    assert len(transport.board.servos) == 3
    assert transport.board.storage.memory == 1000
    assert transport.board.codec.byte_order == "big"
    same = made("virtual://?servos=3&seed=4").board.servos[1].state()
    assert transport.board.servos[1].state() == same
    assert transport.url == "virtual://?servos=3&seed=4&memory=1000&byte_order=big"


def test_the_address_says_what_adding_and_clearing_do() -> None:
    async def main(url: str) -> tuple[int, int, int]:
        transport, heard = made(url), Heard()
        await transport.open(heard)
        await ask(transport, heard, WriteProjectIDRequest(5))
        for _ in range(2):
            await ask(transport, heard, AddMacroRequest(1))
        count = len(transport.board.storage.all(MACRO))
        refused = heard.packets.count(AddMacroResponse(0))
        await ask(transport, heard, ClearAllDataRequest())
        await transport.close()
        return count, refused, transport.board.storage.project_id

    assert run(main("virtual://")) == (1, 0, 0)
    assert run(main("virtual://?on_duplicate=replace&clear=all")) == (1, 0, 0)
    assert run(main("virtual://?on_duplicate=append&clear=records")) == (2, 0, 5)
    assert run(main("virtual://?on_duplicate=reject")) == (1, 1, 0)


@pytest.mark.parametrize(
    "url",
    [
        "virtual://?servos=255",
        "virtual://?servs=3",
        "virtual://?seed=x",
        "virtual://here",
        "virtual:///dev/x",
        "virtual://?drop=2",
        "virtual://?on_duplicate=update",
        "virtual://?clear=none",
        "virtual://?partial_writes=yes",
        "virtual://?bus_powered=2",
    ],
)
def test_other_addresses_are_refused(url: str) -> None:
    with pytest.raises(TransportUnavailable, match=r"virtual://"):
        made(url)


def test_the_board_acts_by_itself_at_the_right_time() -> None:
    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        times: list[float] = []

        class Timed(Heard):
            def data(self, chunk: bytes) -> None:
                times.append(loop.time())
                super().data(chunk)

        transport, heard = VirtualTransport(VirtualBoard()), Timed()
        await transport.open(heard)
        await ask(transport, heard, SubscribeButtonEventRequest(1))
        await asyncio.sleep(1 / 3)
        start = loop.time()
        times.clear()
        transport.board.press_button(3, start)
        await heard.until(3)
        assert heard.packets[1:] == [
            ButtonEventResponse(3, ButtonEventResponse.PRESS),
            ButtonEventResponse(3, ButtonEventResponse.LONG_PRESS),
        ]
        await transport.close()
        return [time - start for time in times]

    assert run(main()) == pytest.approx([0.0, 0.8])


async def test_a_macro_runs_in_the_time_of_the_loop() -> None:
    transport, heard = VirtualTransport(VirtualBoard()), Heard()
    await transport.open(heard)
    await ask(transport, heard, AddMacroRequest(1, "", (MacroCommand(100, 1, loop=7),)))
    await ask(transport, heard, ExecuteMacroRequest(1))
    await asyncio.sleep(0.65)
    assert transport.board.player.macro_id == 1
    await asyncio.sleep(0.1)
    assert transport.board.player.macro_id == 0
    await transport.close()


async def test_several_connections_lead_to_one_board() -> None:
    board = VirtualBoard()
    one, other = VirtualTransport(board), VirtualTransport(board)
    heard_one, heard_other = Heard(), Heard()
    await one.open(heard_one)
    await other.open(heard_other)
    await ask(one, heard_one, SubscribeButtonEventRequest(1))
    await ask(other, heard_other, QueryServoListRequest())
    await one.close()
    assert await ask(other, heard_other, QueryServoListRequest()) == heard_other.packets[0]
    assert len(heard_one.packets) == 1
    await other.close()
    board.press_button(1, asyncio.get_running_loop().time())  # nobody is there, nothing is scheduled


async def test_closing_ends_it_once_and_what_was_under_way_is_lost() -> None:
    transport, heard = VirtualTransport(VirtualBoard()), Heard()
    await transport.open(heard)
    await transport.send(LIST)
    await transport.close()
    await transport.close()
    await asyncio.sleep(1)
    assert heard.ends == [None]
    assert heard.packets == []
    with pytest.raises(ConnectionLost, match="closed"):
        await transport.send(LIST)
    with pytest.raises(OpenError, match="opened once"):
        await transport.open(heard)


async def test_it_cannot_be_used_before_it_is_open_or_opened_twice() -> None:
    transport, heard = VirtualTransport(VirtualBoard()), Heard()
    with pytest.raises(ConnectionLost, match="not open yet"):
        await transport.send(LIST)
    await transport.open(heard)
    with pytest.raises(OpenError, match="opened once"):
        await transport.open(heard)
    await transport.close()


async def test_closed_unopened_it_cannot_be_opened() -> None:
    transport, heard = VirtualTransport(VirtualBoard()), Heard()
    await transport.close()
    with pytest.raises(OpenError):
        await transport.open(heard)
    assert heard.ends == []


async def test_a_receiver_that_fails_ends_the_connection() -> None:
    class Failing(Heard):
        def data(self, chunk: bytes) -> None:
            raise RuntimeError("it broke")

    transport, heard = VirtualTransport(VirtualBoard()), Failing()
    await transport.open(heard)
    await transport.send(LIST)
    error = await heard.until_lost()
    assert isinstance(error, ConnectionLost)
    assert isinstance(error.__cause__, RuntimeError)
    await transport.close()
    assert len(heard.ends) == 1


async def test_faults_of_the_address_are_applied() -> None:
    transport, heard = made("virtual://?servos=1&duplicate=1"), Heard()
    await transport.open(heard)
    await transport.send(LIST)
    assert await heard.until(4) == [QueryServoListResponse((1,))] * 4  # doubled on the way there and back
    assert list(transport.board.servos) == [1]
    await transport.close()


WRITE = Codec().encode(WriteProjectIDRequest(77))


def left(url: str) -> int:
    """Write a project id over `url`, which unplugs itself, and return the one that the board then has."""

    async def main() -> int:
        transport, heard = made(url), Heard()
        await transport.open(heard)
        with suppress(ConnectionLost):
            await transport.send(WRITE)
        assert isinstance(await heard.until_lost(), ConnectionLost)
        await asyncio.sleep(1)  # nothing arrives, and by itself the line is closed
        assert transport.board.sessions == []
        await transport.close()
        assert transport.board.powered == ("bus_powered" not in url)
        return int(transport.board.storage.project_id)

    return run(main())


def test_a_write_can_be_torn_when_the_line_is_unplugged_before_its_answer() -> None:
    assert {
        left(f"virtual://?partial_writes=1&bus_powered=1&seed={seed}&unplug={len(WRITE)}") for seed in range(20)
    } == {0, 77}
    assert {left(f"virtual://?bus_powered=1&seed={seed}&unplug={len(WRITE)}") for seed in range(20)} == {77}
    assert {left(f"virtual://?partial_writes=1&seed={seed}&unplug={len(WRITE)}") for seed in range(20)} == {77}


def test_an_unplugged_transport_is_lost_at_once_with_what_was_on_its_way(tmp_path: Path) -> None:
    async def main(seed: int, *, answered: bool) -> int:
        board = VirtualBoard(seed=seed, kind=BoardKind(partial_writes=True, bus_powered=True))
        path = tmp_path / "board.json"
        path.unlink(missing_ok=True)
        transport, heard = VirtualTransport(board, state=path), Heard()
        await transport.open(heard)
        if answered:
            assert await ask(transport, heard, WriteProjectIDRequest(77)) == WriteProjectIDResponse(1)
        else:
            await transport.send(WRITE)
        transport.unplug()
        assert "unplugged" in str(heard.ends[0])
        assert not board.powered
        with pytest.raises(ConnectionLost):
            await transport.send(WRITE)
        await asyncio.sleep(1)
        assert len(heard.packets) == answered
        await transport.close()
        assert len(heard.ends) == 1
        loaded = VirtualBoard()
        load_state(loaded, path)  # saved, as it was closed
        assert loaded.storage.project_id == board.storage.project_id
        return board.storage.project_id

    assert {run(main(seed, answered=True)) for seed in range(20)} == {77}
    assert {run(main(seed, answered=False)) for seed in range(20)} == {0, 77}


def test_a_plug_that_is_pulled_while_an_answer_is_taken_takes_it_away() -> None:
    class Pulled(Heard):
        def data(self, chunk: bytes) -> None:
            transport.unplug()

    async def main() -> int:
        heard = Pulled()
        await transport.open(heard)
        await transport.send(WRITE)
        await heard.until_lost()
        return int(transport.board.storage.project_id)

    seen = set()
    for seed in range(20):
        transport = VirtualTransport(VirtualBoard(seed=seed, kind=BoardKind(partial_writes=True, bus_powered=True)))
        seen.add(run(main()))
    assert seen == {0, 77}


def test_closing_loses_the_power_at_that_time() -> None:
    async def main() -> float:
        board = VirtualBoard(kind=BoardKind(bus_powered=True))
        board.servos[1].angle = 0.0
        transport = VirtualTransport(board)
        await transport.open(Heard())
        await transport.send(Codec().encode(ExecuteActionRequest((Step(1, 90, 100),))))
        await asyncio.sleep(0.5)
        await transport.close()
        await asyncio.sleep(1)
        board.advance(asyncio.get_running_loop().time())
        return board.servos[1].angle

    assert run(main()) == pytest.approx(45)


def test_a_state_file_is_loaded_on_opening_and_saved_on_closing(tmp_path: Path) -> None:
    url = f"virtual://?state={tmp_path / 'board.json'}"

    async def store() -> None:
        transport, heard = made(url), Heard()
        await transport.open(heard)
        await ask(transport, heard, AddMacroRequest(1))
        await transport.close()

    async def free() -> int:
        transport, heard = made(url), Heard()
        await transport.open(heard)
        answer = await ask(transport, heard, QueryMemorySizeRequest())
        await transport.close()
        assert isinstance(answer, QueryMemorySizeResponse)
        return answer.size

    before = run(free())
    run(store())
    assert run(free()) == before - 38


def test_two_boards_never_overwrite_what_the_other_one_stored(tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    (tmp_path / "link.json").symlink_to(path)

    async def main() -> None:
        first, heard = made(f"virtual://?state={path}"), Heard()
        await first.open(heard)
        for name in ("board.json", "link.json"):
            second = made(f"virtual://?state={tmp_path / name}")
            with pytest.raises(OpenError, match=r"another virtual board uses this file.*servolink virtual --state"):
                await second.open(Heard())
            await second.close()
        await ask(first, heard, WriteProjectIDRequest(7))
        await first.close()
        third = made(f"virtual://?state={path}")
        await third.open(Heard())
        assert third.board.storage.project_id == 7
        await third.close()

    run(main())
    assert sorted(tmp_path.iterdir()) == [path, tmp_path / "link.json"], "a lock was left"


def test_a_board_on_which_nothing_changed_writes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "board.json"

    async def talk(packet: Packet) -> None:
        transport = made(f"virtual://?state={path}")
        await transport.open(Heard())
        await transport.send(Codec().encode(packet))
        await asyncio.sleep(60)
        await transport.close()

    run(talk(WriteProjectIDRequest(7)))
    before = path.stat()
    run(talk(QueryServoListRequest()))
    assert os.path.samestat(before, path.stat()), "the file was replaced"
    run(talk(ExecuteActionRequest((Step(1, 90, 100),))))
    assert not os.path.samestat(before, path.stat()), "servo 1 stands elsewhere, and the file does not say so"


async def test_a_state_file_that_cannot_be_locked_opens_nothing(tmp_path: Path) -> None:
    (tmp_path / ".board.json.servolink-lock").mkdir()
    with pytest.raises(OpenError, match=r"cannot be locked: .*\.board\.json\.servolink-lock: Is a directory"):
        await made(f"virtual://?state={tmp_path / 'board.json'}").open(Heard())


async def test_a_connection_with_a_state_file_is_restored_after_a_loss(tmp_path: Path) -> None:
    async with connect(f"virtual://?state={tmp_path / 'board.json'}", reconnect=True) as board:
        await board.write_project_id(7)
        assert isinstance(board.connection.transport, VirtualTransport)
        board.connection.transport.unplug()
        await until(board, "connected")
        assert await board.project_id() == 7


async def test_changes_are_saved_a_moment_later(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "board.json"

    def saved() -> int:
        board = VirtualBoard()
        load_state(board, path)
        return board.storage.project_id

    transport, heard = made(f"virtual://?state={path}"), Heard()
    await transport.open(heard)
    await ask(transport, heard, QueryServoListRequest())
    await asyncio.sleep(10)
    assert not path.exists(), "nothing was stored"
    for project_id in (5, 6):
        await ask(transport, heard, WriteProjectIDRequest(project_id))
        await asyncio.sleep(1)
        assert saved() == project_id
    path.unlink()
    path.mkdir()
    await ask(transport, heard, WriteProjectIDRequest(7))
    await asyncio.sleep(1)
    assert [record.getMessage().partition(": ")[2] for record in caplog.records] == [
        "the board cannot be saved: Is a directory"
    ]
    path.rmdir()
    await transport.close()
    assert saved() == 7


def test_a_bad_state_file_opens_nothing(tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    path.write_text("nonsense")

    async def main() -> None:
        transport, heard = made(f"virtual://?state={path}"), Heard()
        with pytest.raises(OpenError, match="not a saved board"):
            await transport.open(heard)
        await transport.close()
        assert heard.ends == []

    run(main())
    assert path.read_text() == "nonsense"


async def test_a_board_that_sends_by_itself_begins_when_it_is_opened() -> None:
    await asyncio.sleep(1000)
    async with connect(BoardTransport(KINDS["flooding"]())) as board:
        assert len(await board.servos()) == 4
        assert board.stats.events_received < 10, "one every 5 ms, and not those of 1000 s"
