"""The documentation's example of a transport in a package of its own, installed and used."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import os
import sys
from pathlib import Path

import pytest

from servolink.virtual import HostSession, VirtualBoard
from tests import processes
from tests.transports.wires import on_loop

EXAMPLE = Path(__file__).parents[2] / "docs/examples/servolink-udp"

PROGRAM = """
import asyncio, sys
import servolink

async def main():
    async with servolink.connect(sys.argv[1]) as board:
        print(*await board.servo_ids())

asyncio.run(main())
"""


class Bridge(asyncio.DatagramProtocol):
    """A virtual board behind a UDP port, as a bridge would put it there."""

    def __init__(self) -> None:
        self._board = VirtualBoard(servos=3)
        self._sessions: dict[tuple[str, int], HostSession] = {}
        self._socket: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._socket = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        socket = self._socket
        assert socket is not None
        session = self._sessions.setdefault(addr, self._board.attach(lambda answer: socket.sendto(answer, addr)))
        session.receive(data, asyncio.get_running_loop().time())


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the package into a folder of its own."""
    if importlib.util.find_spec("pip") is None:
        pytest.skip("pip is not installed in this environment")
    folder = tmp_path_factory.mktemp("packages")
    command = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation")
    processes.run((*command, "--target", str(folder), str(EXAMPLE)), check=True)
    return folder


async def ask(installed: Path, url: str) -> tuple[int, str, str]:
    """Run a program that has the package beside servolink."""
    paths = os.pathsep.join((str(installed), *filter(None, sys.path)))
    command = (sys.executable, "-W", "error", "-c", PROGRAM, url)
    process = await processes.start_async(*command, env={**os.environ, "PYTHONPATH": paths})
    out, err = await process.communicate()
    return process.returncode or 0, out.decode(), err.decode()


@on_loop
async def test_an_installed_package_adds_its_scheme(installed: Path) -> None:
    bridge, _ = await asyncio.get_running_loop().create_datagram_endpoint(Bridge, local_addr=("127.0.0.1", 0))
    port = bridge.get_extra_info("sockname")[1]
    assert await ask(installed, f"udp://127.0.0.1:{port}") == (0, "1 2 3\n", "")
    bridge.abort()


@on_loop
async def test_nobody_at_the_other_end_is_a_lost_connection_and_not_a_silence(installed: Path) -> None:
    bridge, _ = await asyncio.get_running_loop().create_datagram_endpoint(Bridge, local_addr=("127.0.0.1", 0))
    port = bridge.get_extra_info("sockname")[1]
    bridge.abort()
    code, _, err = await ask(installed, f"udp://127.0.0.1:{port}")
    assert code == 1
    assert "ConnectionLost" in err
    assert "Connection refused" in err


@on_loop
async def test_the_package_adds_to_the_search(installed: Path) -> None:
    paths = os.pathsep.join((str(installed), *filter(None, sys.path)))
    environment = {**os.environ, "PYTHONPATH": paths, "UDP_BRIDGES": "10.0.0.1:9000"}
    command = (sys.executable, "-W", "error", "-m", "servolink", "list", "--json")
    process = await processes.start_async(*command, env=environment)
    out, _ = await process.communicate()
    assert "udp://10.0.0.1:9000" in [board["url"] for board in json.loads(out)["boards"]]


@on_loop
async def test_its_mistakes_are_told_like_our_own(installed: Path) -> None:
    _, _, err = await ask(installed, "udp://:9000")
    assert "must name a host" in err
    _, _, err = await ask(installed, "udp://127.0.0.1:9000?speed=1")
    assert "unknown option speed" in err
