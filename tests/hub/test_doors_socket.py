"""The door for programs of this machine: a socket that only this user may use.

Module: servolink.hub.doors.socket_door.
"""

from __future__ import annotations

import asyncio
import os
import socket
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from servolink.boards import BoardProfile, BoardSettings, SafetyLimits
from servolink.client import connect
from servolink.errors import ConnectionLost, OpenError, RequestTimeout
from servolink.hub.doors import socket_door
from servolink.hub.hub import Hub
from servolink.protocol import Codec, QueryActionRequest, QueryServoListRequest, QueryServoListResponse
from servolink.support import socket_folder, socket_path
from servolink.virtual import BoardKind, VirtualBoard
from tests.hub.door_hub import GUARD, RawLine, on_hub, raw_socket, sharing, until

LIST = Codec().encode(QueryServoListRequest())
ANSWER = Codec().encode(QueryServoListResponse((1, 2, 3)))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "servolink"


def test_a_board_is_used_through_the_hub_as_if_it_were_alone() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as one, connect("rex") as two:
            assert one.url == two.url == "share://rex"
            assert await one.servo_ids() == await two.servo_ids() == (1, 2, 3)
            assert [program.door for program in hub.programs.values()] == ["share", "share"]
            assert all(f"(pid {os.getpid()})" in program.who for program in hub.programs.values())
            assert one.stats.frames_sent == 1  # no handshake
        await until(lambda: not hub.programs)

    on_hub(use)


@pytest.mark.parametrize("order", ["little", "big"])
def test_byte_order_and_role_are_those_of_the_program(order: Any) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with (
            sharing(hub),
            connect("share://rex?role=watch", byte_order=order) as one,
            connect(f"share://rex?byte_order={order}", reconnect=True) as two,
        ):
            assert await one.servo_ids() == await two.servo_ids()
            assert [str(program.role) for program in hub.programs.values()] == ["watch", "edit"]

    on_hub(use)


def test_the_profile_is_that_of_the_hub() -> None:
    profile = BoardProfile(
        settings=BoardSettings(byte_order="big", depth=4, caption_encoding="big5"), limits=SafetyLimits(speed_cap=30.0)
    )

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url, depth=2) as board:
            assert board.profile is not None
            assert board.profile.profile == profile
            assert board.profile.name == "rex"
            assert board.connection.depth_bound == 2
            assert board.connection.patience == 7.0
            assert board.codec.byte_order == "little"
            assert board.codec.caption_encoding == "big5"
            assert [each.speed_cap for each in board.limits.also] == [30.0]

    on_hub(use, profile=profile, byte_order="little", patience=7.0)


def test_each_request_is_sent_once_and_given_up_a_second_after_the_hub() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            begun = asyncio.get_running_loop().time()
            with pytest.raises(RequestTimeout):
                await board.request(QueryActionRequest(9))
            assert asyncio.get_running_loop().time() - begun >= 1.5
            assert board.stats.retries == 0

    on_hub(use, BoardKind(unknown_ids="silent"), patience=0.5)


def test_the_hub_repeats_in_place_of_the_program() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            asked = asyncio.create_task(board.request(QueryActionRequest(9)))
            await until(lambda: hub.board.stats.retries)
            assert board.stats.retries == 0
            asked.cancel()
            await asyncio.wait((asked,))

    on_hub(use, BoardKind(unknown_ids="silent"), patience=GUARD)


def test_a_hub_that_ends_tells_its_programs_and_leaves_nothing(folder: Path) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url:
            board = await connect(url)
            assert sorted(each.name for each in folder.iterdir()) == ["rex.hub", "rex.sock"]
        with pytest.raises(ConnectionLost):
            await board.servo_ids()
        await board.close()
        assert list(folder.iterdir()) == []
        with pytest.raises(OpenError, match="no hub of this name is running; `servolink share --name rex` starts it"):
            await connect("share://rex")

    on_hub(use)


def test_the_error_for_a_board_in_use_names_the_hub() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            with pytest.raises(OpenError, match=r"nothing listens on port 1 .*shared by a hub .*use share://rex"):
                await connect("tcp://127.0.0.1:1")

    on_hub(use)


# --- who gets in ------------------------------------------------------------------------------------------------


def test_nobody_else_can_open_the_socket(folder: Path) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            assert folder.stat().st_mode & 0o777 == 0o700
            status = (folder / "rex.sock").lstat()
            assert stat.S_ISSOCK(status.st_mode)
            assert stat.S_IMODE(status.st_mode) == 0o600

    on_hub(use)


def test_another_user_is_disconnected(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """As if the folder had not kept them out."""

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            monkeypatch.setattr(socket_door, "is_same_user", lambda _: False)
            with RawLine(raw_socket()) as line:
                assert await line.until_end() == b""
            await until(lambda: "was disconnected: it belongs to another user" in caplog.text)
            assert not hub.programs

    on_hub(use)


def _as_link(folder: Path, other: Path) -> None:
    other.mkdir(mode=0o700)
    folder.rename(other / "moved")
    folder.symlink_to(other / "moved")


def _for_all(folder: Path, other: Path) -> None:
    folder.chmod(0o777)


def _with_a_link(folder: Path, other: Path) -> None:
    (folder / "rex.sock").rename(other)
    (folder / "rex.sock").symlink_to(other)


@pytest.mark.parametrize("spoil", [_as_link, _for_all, _with_a_link])
def test_programs_do_not_follow_others_to_a_hub(
    spoil: Callable[[Path, Path], None], folder: Path, tmp_path: Path
) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub):
            spoil(folder, tmp_path / "other")
            with pytest.raises(OpenError, match="share://rex: "):
                await connect("share://rex")
            assert not hub.programs

    on_hub(use)


def test_a_long_folder_is_no_obstacle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    long = tmp_path / ("x" * 120)
    long.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(long))

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            assert await board.servo_ids() == (1, 2, 3)
            assert (long / "servolink/rex.sock").exists()

    if sys.platform == "linux":
        on_hub(use)
    with pytest.raises(OSError, match="too long for a socket: use a shorter name, or set XDG_RUNTIME_DIR"):
        socket_path(long, "rex")


# --- hubs that were killed, and two of a name -----------------------------------------------------------------------


def test_the_socket_of_a_hub_that_was_killed_is_taken_over(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    left_over = socket.socket(socket.AF_UNIX)
    with socket_folder() as short:
        left_over.bind(socket_path(short, "rex"))
    left_over.close()

    async def use(hub: Hub, _: VirtualBoard) -> None:
        with pytest.raises(OpenError, match="no hub of this name is running"):
            await connect("share://rex")
        async with sharing(hub) as url, connect(url) as board:
            assert await board.servo_ids() == (1, 2, 3)

    on_hub(use)


def test_what_is_not_a_socket_is_left_alone(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    (folder / "rex.sock").write_text("mine")

    async def use(hub: Hub, _: VirtualBoard) -> None:
        with pytest.raises(OpenError, match=r"rex.sock exists and must be a socket; remove the file"):
            await sharing(hub).__aenter__()

    on_hub(use)
    assert (folder / "rex.sock").read_text() == "mine"


def test_a_second_hub_of_a_name_harms_nobody() -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            with pytest.raises(OpenError, match="already"):
                await sharing(hub).__aenter__()
            assert await board.servo_ids() == (1, 2, 3)

    on_hub(use)
