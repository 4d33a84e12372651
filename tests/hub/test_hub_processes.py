"""`servolink share` as a process: killed, started twice, and sought by another user.

Module: servolink.hub.serving.
"""

from __future__ import annotations

import asyncio
import itertools
import json
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from servolink.boards import running_hubs
from servolink.client import connect
from servolink.errors import ConnectionLost
from servolink.support import user_folder
from tests.cli.programs import finished, program, started
from tests.transports.rights import not_root

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Unix sockets and pseudo-terminals")


@pytest.fixture(autouse=True)
def _folders(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have folders of one's own, whose parents let everybody in."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
            monkeypatch.setenv(name, folder)
        yield


@contextmanager
def process(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a command that serves; yield it and the address that it prints first."""
    serving = started(*arguments, "--json")
    assert serving.stdout is not None
    line = serving.stdout.readline()
    assert line, serving.communicate()[1]
    try:
        yield serving, json.loads(line)["listening"]
    finally:
        if serving.poll() is None:
            finished(serving, signal.SIGKILL)


@pytest.fixture(name="port")
def _port() -> Iterator[str]:
    with process("virtual", "--pty", "--servos", "3") as (_, url):
        yield url


def test_a_hub_that_was_killed_is_followed_by_another(port: str) -> None:
    async def lose(hub: subprocess.Popen[str], url: str) -> None:
        async with connect(url) as board:
            assert await board.servo_ids() == (1, 2, 3)
            finished(hub, signal.SIGKILL)
            with pytest.raises(ConnectionLost):
                await board.servo_ids()

    for _ in range(2):
        with process("share", "--board", port, "--name", "rex") as (hub, url):
            assert url == "share://rex"
            assert [each.shares for each in running_hubs()] == [port]
            asyncio.run(lose(hub, url))
        assert (user_folder("runtime") / "rex.sock").exists()
        assert running_hubs() == []


def test_a_program_finds_the_new_hub_by_itself(port: str) -> None:
    async def use() -> None:
        with ExitStack() as hubs:
            first, url = hubs.enter_context(process("share", "--board", port, "--name", "rex"))
            async with connect(url, reconnect=True) as board:
                states = board.states()
                assert await anext(states) == "connected"
                await asyncio.to_thread(finished, first, signal.SIGKILL)
                assert await anext(states) == "lost"
                await asyncio.to_thread(hubs.enter_context, process("share", "--board", port, "--name", "rex"))
                assert await anext(states) == "connected"
                assert await board.servo_ids() == (1, 2, 3)

    asyncio.run(use())


def test_two_hubs_share_neither_a_name_nor_a_board(port: str) -> None:
    with process("share", "--board", port, "--name", "rex") as (hub, _), process("virtual", "--pty") as (_, other):
        shared = f"shared by a hub (pid {hub.pid})"
        name_taken = program("share", "--board", other, "--name", "rex")
        board_taken = program("share", "--board", port, "--name", "other")
        port_taken = program("--board", port, "info")
        assert f"share://rex is {shared}, for {port}, already" in name_taken.err
        assert f"{port} is {shared}: use share://rex" in board_taken.err
        assert f"It is {shared}: use share://rex" in port_taken.err
        assert {name_taken.code, board_taken.code, port_taken.code} == {3}


def leave_open_files(pid: int, count: int) -> None:
    """Let a program open `count` files more than it has open."""
    resource = pytest.importorskip("resource", reason="limits of open files are those of Unix")
    if not hasattr(resource, "prlimit"):
        pytest.skip("only Linux changes the limits of a running program")
    used = {int(each.name) for each in Path(f"/proc/{pid}/fd").iterdir()}
    most = next(most for most in itertools.count(len(used)) if len(used & {*range(most)}) == most - count)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (most, most))


def test_a_hub_with_two_open_files_left_hears_one_stop_after_the_other(port: str) -> None:
    with process("share", "--board", port, "--name", "rex") as (hub, url):
        leave_open_files(hub.pid, 2)
        for _ in range(2):
            said = program("--board", url, "stop")
            assert said.code == 0, said.err
            assert "all 3 servos report that they are stopped and held" in said.out
        assert "was disconnected" not in finished(hub, signal.SIGINT).err


@pytest.mark.skipif("os.getuid() != 0", reason="only root can be another user for a while")
def test_another_user_does_not_get_in(port: str) -> None:
    with process("share", "--board", port, "--name", "rex"), socket.socket(socket.AF_UNIX) as line:
        folder = user_folder("runtime")
        folder.parent.chmod(0o755)
        with not_root():
            assert folder.parent.stat()  # the folder above lets everybody in
            with pytest.raises(PermissionError):
                line.connect(str(folder / "rex.sock"))
            with pytest.raises(PermissionError):
                (folder / "rex.hub").read_bytes()
        folder.chmod(0o755)  # had the folder let everybody in, the socket would not
        with not_root(), pytest.raises(PermissionError):
            line.connect(str(folder / "rex.sock"))
        (folder / "rex.sock").chmod(0o666)  # and had the socket done so, the hub would not
        with not_root():
            line.connect(str(folder / "rex.sock"))
        assert line.recv(1) == b""
