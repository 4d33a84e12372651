"""Profiles of boards: which one is used for an address, and what it sets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from serial.tools import list_ports  # type: ignore[import-untyped]

from servolink import Step, connect
from servolink.boards import (
    Alias,
    Aliases,
    BoardProfile,
    BoardSettings,
    ProfileFile,
    ProfileInUse,
    Resolved,
    SafetyLimits,
    resolve_board,
)
from servolink.connection import ConnectionOptions
from servolink.errors import (
    MotionRefused,
    OpenError,
    ProfileError,
    TransportUnavailable,
)
from servolink.protocol import (
    ExecuteActionRequest,
    QueryActiveJoystickTableRequest,
    QueryMemorySizeRequest,
    QueryRemainPowerRequest,
)
from servolink.transports import create
from tests.client.piped_board import LOST, PipedBoard, opened
from tests.transports.listed_ports import listed, port
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
    Aliases.save(name, Alias(url))
    ProfileFile(name).save(profile)


# --- which profile is used --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("board", ["rex", "tcp://pi:9000", "tcp://pi:9000?patience=2"])
async def test_a_profile_is_used_by_name_and_by_address(board: str, asked: list[ConnectionOptions]) -> None:
    use("rex", "tcp://pi:9000", BoardProfile(settings=BIG))
    async with connect(board) as connected:
        assert connected.profile == ProfileInUse("rex", BoardProfile(settings=BIG))
    (options,) = asked
    assert (options.byte_order, options.caption_encoding, options.transmission_mode) == ("big", "big5", "keep")
    assert options.depth == 4


@pytest.mark.parametrize("board", ["tcp://pi:9001", "tcp://pie:9000", "max"])
async def test_other_boards_have_no_profile(board: str, asked: list[ConnectionOptions]) -> None:
    use("rex", "tcp://pi:9000", BoardProfile(settings=BIG))
    Aliases.save("max", Alias("tcp://pi:9002"))
    async with connect(board) as connected:
        assert connected.profile is None
    assert asked == [ConnectionOptions()]


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
async def test_options_of_the_program_override_the_address_and_that_the_profile(
    option: str, learnt: Any, in_url: Any, given: Any, asked: list[ConnectionOptions]
) -> None:
    ProfileFile("rex").save(BoardProfile(settings=BoardSettings(**{option: learnt})))
    for url in ("tcp://pi:9000", f"tcp://pi:9000?{option}={in_url}"):
        Aliases.save("rex", Alias(url))
        for options in ({}, {option: given}):
            async with connect("rex", **options):
                pass
    assert [getattr(each, option) for each in asked] == [learnt, given, in_url, given]


def test_a_port_is_recognised_by_its_serial_number(monkeypatch: pytest.MonkeyPatch) -> None:
    listed(monkeypatch, port("/dev/ttyACM7", 1, number="A1", pid=2))
    Aliases.save("rex", Alias("serial:///dev/ttyACM0", "A1", 1, 2))
    Aliases.save("no-profile", Alias("serial:///dev/ttyACM7"))
    ProfileFile("rex").save(BoardProfile())
    ProfileFile("no-name").save(BoardProfile())
    for board in ("serial:///dev/ttyACM7", "/dev/ttyACM7", None):
        found = run(resolve_board(board))
        url, name = found.url, found.name
        assert (url, name) == (board or "serial:///dev/ttyACM7", "rex")
    monkeypatch.setattr(list_ports, "comports", lambda: pytest.fail("looked for ports"))
    assert run(resolve_board("tcp://pi:9000")).name is None
    listed(monkeypatch, port("/dev/ttyACM7", 1, number="A1", pid=2))
    # The port at which it was once may have another board by now.
    assert run(resolve_board("serial:///dev/ttyACM0")).name is None


def test_an_address_with_two_profiles_is_not_guessed() -> None:
    for name in ("rex", "max"):
        use(name, "tcp://pi:9000", BoardProfile())
    with pytest.raises(OpenError, match="tcp://pi:9000 has the names max and rex, each with a profile; use a name"):
        run(resolve_board("tcp://pi:9000"))
    assert run(resolve_board("max")).name == "max"


def test_a_broken_address_of_another_name_hinders_nobody() -> None:
    use("rex", "tcp://pi:9000", BoardProfile())
    use("max", "tcp://[", BoardProfile())
    assert run(resolve_board("tcp://pi:9000")).name == "rex"


def test_damaged_names_hide_no_limits() -> None:
    use("rex", "tcp://pi:9000", BoardProfile())
    Aliases.path().write_text("damaged")
    with pytest.raises(TransportUnavailable, match=r"boards\.toml cannot be used"):
        run(resolve_board("tcp://pi:9000"))


def test_names_are_not_even_read_where_there_are_no_profiles() -> None:
    Aliases.save("rex", Alias("tcp://pi:9000"))
    Aliases.path().write_text("damaged")
    assert run(resolve_board("tcp://pi:9000")) == Resolved("tcp://pi:9000", None)


def test_a_damaged_profile_is_refused_by_name_and_by_address() -> None:
    use("rex", "virtual://", BoardProfile())
    ProfileFile("rex").path.write_text("[settings]\ndepth = 900\n")
    for board in ("rex", "virtual://"):
        with pytest.raises(ProfileError, match=r"profiles/rex\.toml, line 2: depth must be 1\.\.64, not 900"):
            run(connect(board).open())


async def test_a_profile_can_be_given() -> None:
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


async def test_limits_of_program_and_profile_hold_both() -> None:
    profile = BoardProfile(limits=SafetyLimits(angles={1: (-20, 50), 2: (0, 90)}, speed_cap=500, speed_caps={2: 50}))
    async with opened(PipedBoard(), profile=profile, angle_limits={1: (-10, 100)}, speed_cap=100) as board:
        for target in ({1: -15}, {1: 60}, {2: 91}):
            with pytest.raises(MotionRefused, match="is outside its limits"):
                await board.move(target, duration=100)
        with pytest.raises(MotionRefused, match="cap is 50"):
            await board.move({2: 80}, duration=1)
        with pytest.raises(MotionRefused, match="cap is 100"):
            await board.move({1: 50}, duration=0.2)
        await board.move({1: 50, 2: 40}, duration=1)


async def test_soft_start_and_interval_unit_of_the_profile_are_used() -> None:
    profile = BoardProfile(
        settings=BoardSettings(interval_unit=0.02), limits=SafetyLimits(soft_start=10, speed_caps={2: 5})
    )
    fake = PipedBoard()
    for servo in fake.servos.values():
        servo.angle = 0.0
    async with opened(fake, profile=profile, soft_start=20) as board:
        assert await board.move({1: 20, 3: 0}, duration=0.5) == 2.0
        assert await board.move({2: 20}, duration=0.5) == 4.0
    assert fake.executed_of(ExecuteActionRequest) == [
        ExecuteActionRequest((Step(1, 20, 100), Step(3, 0, 100))),
        ExecuteActionRequest((Step(2, 20, 200),)),
    ]


@pytest.mark.parametrize(
    ("unsupported", "sendings"),
    [
        (("QueryMemorySize",), 16),  # fewer kinds need a longer word
        (("QueryMemorySize", "QueryRemainPower"), 7),  # the list of servos brings others
    ],
)
async def test_the_handshake_does_without_what_the_board_does_not_answer(
    unsupported: tuple[str, ...], sendings: int
) -> None:
    fake = PipedBoard()
    for kind in (QueryMemorySizeRequest, QueryRemainPowerRequest)[: len(unsupported)]:
        fake.usual_of[kind] = LOST
    async with connect(fake, profile=BoardProfile(settings=BoardSettings(unsupported=unsupported))) as board:
        assert len(fake.sent) == sendings
        assert {type(packet).__name__.removesuffix("Request") for _, packet in fake.sent}.isdisjoint(unsupported)
        assert board.stats.retries == 0


async def test_a_profile_that_is_wrong_about_what_is_unsupported_hinders_nothing() -> None:
    names = ("QueryProjectID", "QueryMemorySize", "QueryRemainPower", "QueryActiveJoystickTable")
    fake = PipedBoard()
    async with connect(fake, profile=BoardProfile(settings=BoardSettings(unsupported=names))) as board:
        assert await board.servo_ids() == (1, 2, 3, 4)
    fake = PipedBoard()
    fake.usual_of[QueryActiveJoystickTableRequest] = LOST
    async with connect(fake, profile=BoardProfile(settings=BoardSettings(unsupported=names[:1]))) as board:
        assert await board.servo_ids() == (1, 2, 3, 4)
