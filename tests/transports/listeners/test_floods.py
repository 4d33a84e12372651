"""Floods of connections at each door of a process with few descriptors: it lives, answers, and a stop gets through.

Module: servolink.transports.listeners.strangers.
"""

from __future__ import annotations

import asyncio
import sys
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest
from aiohttp import ClientSession

from servolink import connect
from servolink.protocol import MAGIC
from tests import processes

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs limits of Unix")

_FILES = 128
_GUARD = 60.0
_LIMITED = f"""
import asyncio, resource, runpy, sys
resource.setrlimit(resource.RLIMIT_NOFILE, ({_FILES}, {_FILES}))
"""
_SERVOLINK = 'runpy.run_module("servolink", run_name="__main__")'
_METRICS = """
from types import SimpleNamespace
from servolink.gateways.metrics import serve_metrics
from servolink.fleet.roster import Roster
async def main():
    async with serve_metrics(SimpleNamespace(roster=Roster(), connections=1), "127.0.0.1", 0) as port:
        print(f"metrics http://127.0.0.1:{port}/metrics", flush=True)
        await asyncio.Event().wait()
asyncio.run(main())
"""


class Door(NamedTuple):
    """Program with a door."""

    command: str
    answers: Callable[[str, str], Awaitable[object]]
    """Raises unless the door at an address answers; gets the second line of the program, too."""
    has_hub: bool = True
    needs: str = "aiohttp"


async def _page(url: str, _: str) -> None:
    address, _, token = url.partition("/#token=")
    async with ClientSession() as http, http.ws_connect(f"{address}/ws", headers={"Origin": address}) as page:
        await page.send_json({"token": token})
        assert (await page.receive_json())["name"]


async def _model(url: str, token: str) -> None:
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    async with ClientSession() as http, http.post(url, headers=headers, data="{}") as response:
        assert response.status not in {401, 503}


async def _foxglove(url: str, _: str) -> None:
    async with ClientSession() as http, http.ws_connect(url, protocols=["foxglove.sdk.v1"]) as program:
        assert (await program.receive_json())["op"] == "serverInfo"


async def _board(url: str, _: str) -> None:
    async with connect(url) as board:
        assert await board.servo_ids()


async def _metrics(url: str, _: str) -> None:
    async with ClientSession() as http, http.get(url) as response:
        assert "servolink_fleet_boards" in await response.text()
    async with ClientSession() as http, http.get(url, headers={"Host": "evil.example"}) as response:
        assert response.status == 421


DOORS = {
    "studio": Door("studio --demo --no-browser", _page),
    "mcp": Door("mcp --http 0 --board virtual://", _model, needs="mcp"),
    "foxglove": Door("foxglove --board virtual:// --listen 127.0.0.1:0", _foxglove, needs="foxglove"),
    "metrics": Door("", _metrics, has_hub=False, needs="prometheus_client"),
    "share --tcp": Door("share --board virtual:// --tcp 127.0.0.1:0", _board),
    "virtual --tcp": Door("virtual --tcp 127.0.0.1:0", _board, has_hub=False),
}
_HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: HOST\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
)
_REQUEST = b"GET /mcp HTTP/1.1\r\nHost: HOST\r\n\r\n"


@asynccontextmanager
async def served(door: Door, folder: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[list[str]]:
    """Run a program with few descriptors; yield the words of its first lines. It must not have failed at the end."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    program = _LIMITED + (_SERVOLINK if door.command else _METRICS)
    serving = processes.start((sys.executable, "-c", program, *door.command.split()))
    assert serving.stdout is not None
    words = list[str]()
    while not (words and "://" in words[-1] and not words[-1].startswith("share")):
        words += (await asyncio.to_thread(serving.stdout.readline)).split()
    if door.needs == "mcp":
        words += (await asyncio.to_thread(serving.stdout.readline)).split()
    yield words
    assert serving.poll() is None
    serving.terminate()
    _, errors = await asyncio.to_thread(processes.finish, serving)
    assert "Traceback" not in errors
    assert "no connection can be accepted" not in errors


@asynccontextmanager
async def flooded(url: str, first: bytes) -> AsyncIterator[None]:
    """Open twice as many connections as the program may have files, that send `first` and stay."""
    place = _place(url)
    opened = list[asyncio.StreamWriter]()
    for _ in range(2 * _FILES):
        with suppress(OSError):
            _, writer = await asyncio.open_connection(*place.split(":"))
            opened.append(writer)
            writer.write(first.replace(b"HOST", place.encode()))
    yield
    for writer in opened:
        writer.transport.abort()


_OF_HTTP = (b"", b"GET / HTTP/1.1\r\nHost: ", _REQUEST)
FLOODS = {name: _OF_HTTP if name in {"studio", "mcp", "foxglove", "metrics"} else (b"",) for name in DOORS}
"""What the connections of each flood of a door send first. The door answers in the flood."""
PROGRAMS = {"foxglove": (_HANDSHAKE,), "share --tcp": (MAGIC,), "virtual --tcp": (MAGIC,)}
"""The same for connections that show what all programs can show, which are few: the door answers after the flood."""


@pytest.mark.parametrize("name", DOORS)
def test_a_door_lives_through_floods_and_a_stop_gets_through(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    door = DOORS[name]
    if find_spec(door.needs) is None:
        pytest.skip(f"needs {door.needs}")

    async def main() -> None:
        async with served(door, tmp_path, monkeypatch) as words:
            for first in (*FLOODS[name], *PROGRAMS.get(name, ())):
                try:
                    await _try(door, words, first, answers=first in FLOODS[name])
                except Exception as error:
                    error.add_note(f"in the flood of {first!r}")
                    raise

    asyncio.run(main())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["studio", "mcp", "foxglove", "share --tcp"])
def test_a_flood_delays_no_local_stop(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    door = DOORS[name]
    if find_spec(door.needs) is None:
        pytest.skip(f"needs {door.needs}")

    async def main() -> tuple[float, float]:
        async with served(door, tmp_path, monkeypatch) as words:
            idle = await _time_of_stops()
            flood = asyncio.ensure_future(_keep_flooding(_address(words)))
            await asyncio.sleep(1)
            busy = await _time_of_stops()
            flood.cancel()
            await asyncio.wait((flood,))
            return idle, busy

    idle, busy = asyncio.run(main())
    assert busy < idle + 0.1


async def _time_of_stops() -> float:
    """Return the seconds in which nine of ten local programs have connected and stopped the board."""
    found, now = list[float](), asyncio.get_running_loop().time
    for _ in range(30):
        at = now()
        async with connect("share://virtual") as board:
            await board.stop()
            found.append(now() - at)
    return sorted(found)[27]


async def _keep_flooding(url: str) -> None:
    """Open 500 connections a second, of which 500 stay."""
    opened = deque[asyncio.StreamWriter]()
    try:
        while True:
            with suppress(OSError):
                _, writer = await asyncio.open_connection(*_place(url).split(":"))
                writer.write(b"GET / HTTP/1.1\r\n" * url.startswith(("http", "ws")))
                opened.append(writer)
            if len(opened) > 500:
                opened.popleft().transport.abort()
            await asyncio.sleep(0.002)
    finally:
        for writer in opened:
            writer.transport.abort()


def _address(words: list[str]) -> str:
    return next(word for word in words if "://" in word and not word.startswith("share"))


def _place(url: str) -> str:
    return url.partition("://")[2].partition("/")[0]


async def _try(door: Door, words: list[str], first: bytes, *, answers: bool) -> None:
    url = _address(words)
    async with asyncio.timeout(_GUARD):
        async with flooded(url, first):
            if answers:
                await door.answers(url, words[-1])
            if door.has_hub:
                async with connect("share://virtual") as board:
                    await board.stop()
        await door.answers(url, words[-1])
