"""Proof that a flood of connections delays no stop, in a studio with 1,024 descriptors.

`test_attacks.py` has the smaller tests of `servolink.transports.listeners.strangers`.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientSession

from servolink import connect
from tests import processes
from tests.studio.serving import call, welcomed
from tests.studio.test_attacks import FIRST

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="needs limits of Unix")]

_RATE = 500  # connections a second
_TRIALS = 40
_LIMIT = 0.1  # seconds until a stop is answered, for nine of ten; the flood needs this machine as well
_LINKED = """
import asyncio
from servolink.studio.links import Links
from servolink.studio.robots import VIRTUAL
from servolink.studio.server import serve_studio
from servolink.studio.start import studio_for
async def main():
    async with studio_for(VIRTUAL) as studio, serve_studio(studio, "127.0.0.1", 0) as (gate, port):
        studio.links = Links(gate, port, ("127.0.0.1",))
        links = {each.role: each.address.partition("#token=")[2] for each in studio.links.addresses()}
        print(f"http://127.0.0.1:{port}", gate.new_token("edit"), links["watch"], flush=True)
        await asyncio.Event().wait()
asyncio.run(main())
"""
_FLOODING = """
import asyncio, sys
from aiohttp import ClientSession, TCPConnector
address, token, pages, size = sys.argv[1:]
message = '{"jsonrpc": "2.0", "id": 1, "method": "status", "params": {"x": "%s"}}' % ("a" * int(size))
async def flood(http):
    async with http.ws_connect(f"{address}/ws", headers={"Origin": address}) as page:
        await page.send_json({"token": token})
        async def read():
            async for _ in page:
                pass
        reading = asyncio.ensure_future(read())
        while not page.closed:
            await page.send_str(message)
async def main():
    async with ClientSession(connector=TCPConnector(limit=0)) as http:
        await asyncio.gather(*(flood(http) for _ in range(int(pages))), return_exceptions=True)
asyncio.run(main())
"""
_STUDIO = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (1024, 1024))
sys.argv[1:] = ["studio", "--demo", "--no-browser"]
runpy.run_module("servolink", run_name="__main__")
"""


@asynccontextmanager
async def flooded(host: str, first: bytes) -> AsyncIterator[list[asyncio.StreamWriter]]:
    """Open `_RATE` connections a second that send `first` and stay open."""
    opened: list[asyncio.StreamWriter] = []

    async def flood() -> None:
        while True:
            with suppress(OSError):
                _, writer = await asyncio.open_connection(*host.split(":"))
                writer.write(first)
                opened.append(writer)
            for old in opened[: -2 * _RATE]:
                old.transport.abort()
            del opened[: -2 * _RATE]
            await asyncio.sleep(1 / _RATE)

    task = asyncio.ensure_future(flood())
    yield opened
    task.cancel()
    for writer in opened:
        writer.transport.abort()


async def times_to_stop(url: str, first: str) -> dict[str, list[float]]:
    """Return the seconds until a stop was answered: to a new page, an open one, and a local program."""
    address, _, token = url.partition("/#token=")
    clock, host = asyncio.get_running_loop().time, address.removeprefix("http://")
    found: dict[str, list[float]] = {"new page": [], "open page": [], "local program": []}

    async def opened(http: ClientSession) -> Any:
        page = await http.ws_connect(f"{address}/ws", headers={"Origin": address})
        await welcomed(page, token)
        return page

    async with ClientSession() as http:
        before = await opened(http)
        async with flooded(host, first.replace("{host}", host).encode()) as connections:
            while len(connections) < 2 * _RATE:
                await asyncio.sleep(0.05)
            for _ in range(_TRIALS):
                at = clock()
                page = await opened(http)
                assert (await call(page, "stop"))["result"] == {}
                found["new page"].append(clock() - at)
                at = clock()
                assert (await call(before, "stop"))["result"] == {}
                found["open page"].append(clock() - at)
                at = clock()
                async with connect("share://virtual") as board:
                    await board.stop()
                    found["local program"].append(clock() - at)
                await page.close()
                await asyncio.sleep(0.05)
        await before.close()
    return found


@pytest.mark.parametrize("first", FIRST.values(), ids=FIRST)
def test_a_stop_comes_in_while_others_open_500_connections_a_second(first: str, user: Path) -> None:
    studio = processes.start((sys.executable, "-c", _STUDIO))
    assert studio.stdout is not None
    url = studio.stdout.readline().split()[-1]
    for way, times in asyncio.run(times_to_stop(url, first)).items():
        assert sorted(times)[_TRIALS * 9 // 10] < _LIMIT, way
    studio.terminate()
    _, errors = processes.finish(studio)
    assert "Traceback" not in errors
    assert "no connection can be accepted" not in errors


@pytest.mark.parametrize("size", [0, 900_000])
def test_pages_of_a_link_that_send_without_end_delay_no_stop(size: int, user: Path) -> None:
    studio = processes.start((sys.executable, "-c", _LINKED))
    assert studio.stdout is not None
    address, owner, link = studio.stdout.readline().split()

    async def times(page: Any) -> float:
        clock, found = asyncio.get_running_loop().time, []
        for _ in range(_TRIALS):
            at = clock()
            assert (await call(page, "stop"))["result"] == {}
            found.append(clock() - at)
            await asyncio.sleep(0.02)
        return sorted(found)[_TRIALS * 9 // 10]

    async def main() -> tuple[float, float]:
        async with ClientSession() as http, http.ws_connect(f"{address}/ws", headers={"Origin": address}) as page:
            await welcomed(page, owner)
            idle = await times(page)
            flood = processes.start((sys.executable, "-c", _FLOODING, address, link, "60", str(size)))
            await asyncio.sleep(3)
            busy = await times(page)
            assert flood.poll() is None
            flood.kill()
            return idle, busy

    idle, busy = asyncio.run(main())
    assert busy < idle + _LIMIT / 2
    assert studio.poll() is None
