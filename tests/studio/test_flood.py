"""Proof that a flood of connections delays no stop, in a studio with 1,024 descriptors.

`test_attacks.py` has the smaller tests of `servolink.studio.connections`.
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
