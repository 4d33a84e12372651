"""The profile of a board is used by its name and by its address, and guards it against motion of another one."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from servolink import Action, Board, Macro, MacroCommand, Step, connect
from servolink.client import connect as connecting
from servolink.connection.options import ConnectionOptions
from servolink.discovery import names
from servolink.discovery.names import Alias, aliases_path, resolve_board, save_alias
from servolink.errors import (
    MotionRefused,
    OpenError,
    ProfileError,
    RequestError,
    RequestTimeout,
    TransportUnavailable,
    WrongBoard,
)
from servolink.profiles.profile import BoardIdentityRecord, BoardProfile, BoardSettings, ProfileInUse, SafetyLimits
from servolink.profiles.store import profile_path, save_profile
from servolink.protocol.editing import ExecuteMacroRequest
from servolink.protocol.joystick import QueryActiveJoystickTableRequest
from servolink.protocol.record_types import ACTION, MACRO
from servolink.protocol.servos import (
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    SetServoParameterRequest,
)
from servolink.protocol.settings import QueryMemorySizeRequest, QueryMemorySizeResponse, QueryRemainPowerRequest
from servolink.transports.device_info import DeviceInfo, PortIdentity
from servolink.transports.registry import create
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serve import serve
from tests.client.fake_board import LOST, FakeBoard, lie, opened, turns_of_the_loop
from tests.client.sockets import Socket
from tests.virtual_time import run

BIG = BoardSettings(byte_order="big", caption_encoding="big5", transmission_mode="keep", depth=4)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.fixture(name="asked")
def _asked(monkeypatch: pytest.MonkeyPatch) -> list[ConnectionOptions]:
    """Connect to virtual boards that understand the byte order asked for; return the options of each connection."""
    asked: list[ConnectionOptions] = []
    open_connection = connect._open_connection

    async def opening(self: connect, transport: Any, options: ConnectionOptions, *others: Any) -> Any:
        asked.append(options)
        return await open_connection(self, create(f"virtual://?byte_order={options.byte_order}"), options, *others)

    monkeypatch.setattr(connect, "_open_connection", opening)
    return asked


def use(name: str, url: str, profile: BoardProfile) -> None:
    save_alias(name, Alias(url))
    save_profile(name, profile)


# --- which profile is used --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("board", ["rex", "tcp://pi:9000", "tcp://pi:9000?patience=2"])
def test_a_profile_is_used_by_name_and_by_the_address_of_the_name(board: str, asked: list[ConnectionOptions]) -> None:
    async def main() -> None:
        use("rex", "tcp://pi:9000", BoardProfile(settings=BIG))
        async with connect(board) as connected:
            assert connected.profile == ProfileInUse("rex", BoardProfile(settings=BIG))
        (options,) = asked
        assert (options.byte_order, options.caption_encoding, options.transmission_mode) == ("big", "big5", "keep")
        assert options.depth == 4

    run(main())


@pytest.mark.parametrize("board", ["tcp://pi:9001", "tcp://pie:9000", "max"])
def test_other_boards_have_no_profile(board: str, asked: list[ConnectionOptions]) -> None:
    async def main() -> None:
        use("rex", "tcp://pi:9000", BoardProfile(settings=BIG))
        save_alias("max", Alias("tcp://pi:9002"))
        async with connect(board) as connected:
            assert connected.profile is None
        assert asked == [ConnectionOptions()]

    run(main())


@pytest.mark.parametrize(
    ("option", "learnt", "in_url", "given"),
    [
        ("byte_order", "big", "little", "big"),
        ("caption_encoding", "big5", "latin-1", "cp437"),
        ("transmission_mode", "keep", "auto", 1),
        ("depth", 4, 3, 2),
        ("write_depth", 4, 3, 2),
    ],
)
def test_options_of_the_program_override_the_address_and_that_the_profile(
    option: str, learnt: Any, in_url: Any, given: Any, asked: list[ConnectionOptions]
) -> None:
    async def main() -> None:
        save_profile("rex", BoardProfile(settings=BoardSettings(**{option: learnt})))
        for url in ("tcp://pi:9000", f"tcp://pi:9000?{option}={in_url}"):
            save_alias("rex", Alias(url))
            for options in ({}, {option: given}):
                async with connect("rex", **options):
                    pass
        assert [getattr(each, option) for each in asked] == [learnt, given, in_url, given]

    run(main())


SERIAL = DeviceInfo("serial:///dev/ttyACM7", "", PortIdentity(1, 2, "A1"))


def test_a_port_is_recognised_by_its_serial_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(names, "search", lambda: [SERIAL])
    save_alias("rex", Alias("serial:///dev/ttyACM0", "A1", 1, 2))
    save_alias("no-profile", Alias("serial:///dev/ttyACM7"))
    save_profile("rex", BoardProfile())
    save_profile("no-name", BoardProfile())
    for board in ("serial:///dev/ttyACM7", "/dev/ttyACM7", None):
        url, name = run(resolve_board(board))
        assert (url, name) == (board or SERIAL.url, "rex")
    monkeypatch.setattr(names, "search", lambda: pytest.fail("looked for ports"))
    assert run(resolve_board("tcp://pi:9000")).name is None
    monkeypatch.setattr(names, "search", lambda: [SERIAL])
    # The port at which it was once may have another board by now.
    assert run(resolve_board("serial:///dev/ttyACM0")).name is None


def test_an_address_with_two_profiles_is_not_guessed() -> None:
    for name in ("rex", "max"):
        use(name, "tcp://pi:9000", BoardProfile())
    with pytest.raises(OpenError, match="tcp://pi:9000 is max and rex, each with a profile of its own; use one of the"):
        run(resolve_board("tcp://pi:9000"))
    assert run(resolve_board("max")).name == "max"


def test_a_broken_address_of_another_name_hinders_nobody() -> None:
    use("rex", "tcp://pi:9000", BoardProfile())
    use("max", "tcp://[", BoardProfile())
    assert run(resolve_board("tcp://pi:9000")).name == "rex"


def test_damaged_names_hide_no_limits() -> None:
    use("rex", "tcp://pi:9000", BoardProfile())
    aliases_path().write_text("damaged")
    with pytest.raises(TransportUnavailable, match=r"boards\.toml cannot be used"):
        run(resolve_board("tcp://pi:9000"))


def test_names_are_not_even_read_where_there_are_no_profiles() -> None:
    save_alias("rex", Alias("tcp://pi:9000"))
    aliases_path().write_text("damaged")
    assert run(resolve_board("tcp://pi:9000")) == ("tcp://pi:9000", None)


def test_a_damaged_profile_is_refused_by_name_and_by_address() -> None:
    use("rex", "virtual://", BoardProfile())
    profile_path("rex").write_text("[settings]\ndepth = 900\n")
    for board in ("rex", "virtual://"):
        with pytest.raises(ProfileError, match=r"profiles/rex\.toml, line 2: depth must be 1\.\.64, not 900"):
            run(connect(board).open())


def test_a_profile_can_be_given() -> None:
    async def main() -> None:
        use("rex", "tcp://pi:9000", BoardProfile(settings=BIG))
        given = BoardProfile(settings=BoardSettings(depth=2))
        async with connect("virtual://", profile=given) as board:
            assert board.profile == (None, given)
        async with connect("virtual://", profile="rex", byte_order="little") as board:
            assert repr(board) == '<Board "rex" virtual:// connected>'
            assert board.profile == ("rex", BoardProfile(settings=BIG))
        with pytest.raises(ProfileError, match=r"max has no profile \(known: rex\); `servolink doctor max --learn`"):
            await connect("virtual://", profile="max")
        with pytest.raises(TypeError, match="profile must be a BoardProfile, the name of a board or None, not 3"):
            connect("virtual://", profile=3)  # type: ignore[arg-type]

    run(main())


def test_limits_of_program_and_profile_hold_both() -> None:
    profile = BoardProfile(limits=SafetyLimits(angles={1: (-20, 50), 2: (0, 90)}, speed_cap=500, speed_caps={2: 50}))

    async def main() -> None:
        async with opened(FakeBoard(), profile=profile, angle_limits={1: (-10, 100)}, speed_cap=100) as board:
            for target in ({1: -15}, {1: 60}, {2: 91}):
                with pytest.raises(MotionRefused, match="is outside its limits"):
                    await board.move(target, duration=100)
            with pytest.raises(MotionRefused, match="cap is 50"):
                await board.move({2: 80}, duration=1)
            with pytest.raises(MotionRefused, match="cap is 100"):
                await board.move({1: 50}, duration=0.2)
            await board.move({1: 50, 2: 40}, duration=1)

    run(main())


def test_soft_start_and_interval_unit_of_the_profile_are_used() -> None:
    profile = BoardProfile(
        settings=BoardSettings(interval_unit=0.02), limits=SafetyLimits(soft_start=10, speed_caps={2: 5})
    )

    async def main() -> None:
        fake = FakeBoard()
        for servo in fake.virtual.servos.values():
            servo.angle = 0.0
        async with opened(fake, profile=profile, soft_start=20) as board:
            assert await board.move({1: 20, 3: 0}, duration=0.5) == 2.0
            assert await board.move({2: 20}, duration=0.5) == 4.0
        assert fake.executed_of(ExecuteActionRequest) == [
            ExecuteActionRequest((Step(1, 20, 100), Step(3, 0, 100))),
            ExecuteActionRequest((Step(2, 20, 200),)),
        ]

    run(main())


@pytest.mark.parametrize("unsupported", [("QueryMemorySize",), ("QueryMemorySize", "QueryRemainPower")])
def test_the_handshake_does_without_what_the_board_does_not_answer(unsupported: tuple[str, ...]) -> None:
    async def main() -> None:
        fake = FakeBoard()
        for kind in (QueryMemorySizeRequest, QueryRemainPowerRequest)[: len(unsupported)]:
            fake.usual_of[kind] = LOST
        async with connect(fake, profile=BoardProfile(settings=BoardSettings(unsupported=unsupported))) as board:
            assert len(fake.sent) == 16  # fewer kinds need a longer word
            assert {type(packet).__name__.removesuffix("Request") for _, packet in fake.sent}.isdisjoint(unsupported)
            assert board.stats.retries == 0

    run(main())


def test_a_profile_that_is_wrong_about_what_is_unsupported_hinders_nothing() -> None:
    names = ("QueryProjectID", "QueryMemorySize", "QueryRemainPower", "QueryActiveJoystickTable")

    async def main() -> None:
        fake = FakeBoard()
        async with connect(fake, profile=BoardProfile(settings=BoardSettings(unsupported=names))) as board:
            assert await board.servo_ids() == (1, 2, 3, 4)
        fake = FakeBoard()
        fake.usual_of[QueryActiveJoystickTableRequest] = LOST
        async with connect(fake, profile=BoardProfile(settings=BoardSettings(unsupported=names[:1]))) as board:
            assert await board.servo_ids() == (1, 2, 3, 4)

    run(main())


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


def other_board() -> FakeBoard:
    """Return a board with other servos than rex, on which something is stored."""
    fake = FakeBoard(servos=5)
    fake.virtual.storage.project_id = 3
    return fake


def store(fake: FakeBoard) -> None:
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
        before = fake.virtual.storage.free
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
        assert fake.virtual.storage.free == before
        assert fake.virtual.storage.project_id == 3

    run(main())
    assert caplog.messages.count(caplog.messages[0]) == 1
    assert "it can be read, but neither moved nor changed" in caplog.messages[0]
    assert caplog.records[0].levelno == logging.WARNING


@pytest.mark.parametrize("name", FREE)
def test_another_board_can_be_stopped_released_and_read(name: str) -> None:
    async def main() -> None:
        fake = other_board()
        store(fake)
        async with opened(fake, profile=REX) as board:
            before = len(fake.executed)
            await FREE[name](board)
            assert len(fake.executed) > before

    run(main())


def test_a_stop_does_not_wait_for_the_check() -> None:
    async def main() -> None:
        fake = FakeBoard()
        fake.usual_of[QueryServoListRequest] = LOST
        async with connect(fake, profile=REX, handshake=False) as board:
            moving = asyncio.create_task(board.move({1: 5}, duration=1))
            await asyncio.sleep(1)
            await board.stop()
            with pytest.raises((RequestTimeout, RequestError)):
                await moving
        assert not fake.executed_of(ExecuteActionRequest)
        assert fake.executed_of(SetServoParameterRequest)

    run(main())


def test_a_macro_asked_for_before_a_stop_is_not_started_after_it() -> None:
    async def main() -> None:
        fake = FakeBoard()
        store(fake)
        async with opened(fake, profile=REX, handshake=False) as board:
            starting = asyncio.create_task(board.run_macro(2))
            await turns_of_the_loop(3)
            await board.stop()
            with pytest.raises(RequestError, match="a stop came first"):
                await starting
        assert not fake.executed_of(ExecuteMacroRequest)

    run(main())


def test_the_right_board_is_asked_once_for_each_connection() -> None:
    async def main() -> None:
        fake = FakeBoard()
        store(fake)
        async with connect(fake, profile=REX) as board:
            assert len(fake.sent_of(QueryServoListRequest)) == 1
            await asyncio.gather(board.move({1: 5}, duration=1), board.run_action(1), board.write_project_id(8))
        assert len(fake.sent_of(QueryServoListRequest)) == 1
        assert fake.executed_of(ExecuteActionRequest)

    run(main())


def test_without_a_handshake_the_board_is_checked_before_it_moves() -> None:
    async def main() -> None:
        fake = FakeBoard()
        fake.plan(QueryServoListRequest, lie(QueryServoListResponse((9,))))
        async with connect(fake, profile=REX, handshake=False) as board:
            await board.servos()
            assert not fake.sent_of(QueryServoListRequest)
            with pytest.raises(WrongBoard):
                await board.move({1: 5}, duration=1)
            await board.move({1: 5}, duration=1)  # it was a damaged response, perhaps: now it is right
            assert fake.executed_of(ExecuteActionRequest)

    run(main())


def test_a_check_that_is_not_answered_refuses_too() -> None:
    async def main() -> None:
        fake = FakeBoard()
        fake.usual_of[QueryServoListRequest] = LOST
        async with opened(fake, profile=REX, handshake=False) as board:
            with pytest.raises(RequestTimeout, match="QueryServoList"):
                await board.move({1: 5}, duration=1)
            with pytest.raises(RequestTimeout, match="ExecuteMacro"):
                await board.request(ExecuteMacroRequest(2), timeout=0.2)
        assert not fake.executed_of(ExecuteActionRequest)

    run(main())


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
def test_a_board_differs_by_what_is_known_of_both(
    identity: BoardIdentityRecord, is_same: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servolink.discovery.search.identity_of", lambda url: SERIAL.identity)

    async def main() -> None:
        async with connect(FakeBoard(), profile=BoardProfile(identity=identity)) as board:
            if is_same:
                await board.move({1: 5}, duration=1)
            else:
                with pytest.raises(WrongBoard) as refused:
                    await board.move({1: 5}, duration=1)
                assert "\x1b" not in str(refused.value)

    run(main())


def test_what_the_board_does_not_report_is_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servolink.discovery.search.identity_of", lambda url: None)
    identity = BoardIdentityRecord(servo_ids=(1,), memory_total=5, serial_number="A1")
    settings = BoardSettings(unsupported=("QueryServoList",))

    async def main() -> None:
        fake = FakeBoard()
        fake.usual_of[QueryMemorySizeRequest] = lie(QueryMemorySizeResponse(100))
        async with connect(fake, profile=BoardProfile(identity=identity, settings=settings)) as board:
            await board.move({1: 5}, duration=1)
        assert not fake.sent_of(QueryServoListRequest)

    run(main())


def test_another_board_served_in_the_place_of_rex_is_refused() -> None:
    async def main() -> None:
        board, place = VirtualBoard(4), "127.0.0.1:0"
        use("rex", "tcp://127.0.0.1:1", REX)
        for servos in (4, 5):
            board = VirtualBoard(servos)
            async with serve(board, tcp=place) as (url,):
                place = url.removeprefix("tcp://")
                save_alias("rex", Alias(url))
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


def test_the_memory_is_in_bytes_whatever_the_board_counts_in() -> None:
    async def main() -> None:
        fake = FakeBoard()
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

    run(main())


def test_another_board_that_comes_back_under_the_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
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
            with pytest.raises(
                WrongBoard, match=r"learn it again: servolink doctor rex --learn; else .* servolink use"
            ):
                await board.move({1: 5}, duration=1)
            socket.pull()
            socket.plug(ours)
            await asyncio.sleep(5)
            await board.move({1: 5}, duration=1)

    run(main())
