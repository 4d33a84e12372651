"""A studio that is served to a test, and pages as their WebSockets."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, NamedTuple

from aiohttp import ClientSession, ClientWebSocketResponse

from servolink.studio.gate import Gate
from servolink.studio.robots import VIRTUAL
from servolink.studio.server import serve_studio
from servolink.studio.start import studio_for
from servolink.studio.studio_methods import Studio

LIMIT = 120.0


class Place(NamedTuple):
    """A studio that is served."""

    studio: Studio
    gate: Gate
    address: str
    http: ClientSession

    def page(self, **headers: str) -> Any:
        """Return a WebSocket as the page opens it, with other `headers`."""
        return self.http.ws_connect(f"{self.address}/ws", headers={"Origin": self.address} | headers)


@asynccontextmanager
async def studio() -> AsyncIterator[Place]:
    async with (
        asyncio.timeout(LIMIT),
        studio_for(VIRTUAL) as served,
        serve_studio(served, "127.0.0.1", 0) as (gate, port),
        ClientSession() as http,
    ):
        yield Place(served, gate, f"http://127.0.0.1:{port}", http)


def run(test: Callable[[Place], Awaitable[None]]) -> None:
    async def main() -> None:
        async with studio() as place:
            await test(place)

    asyncio.run(main())


async def welcomed(page: ClientWebSocketResponse, token: str) -> dict[str, Any]:
    await page.send_json({"token": token, "who": "Tablet 2"})
    return dict(json.loads(await page.receive_str()))


async def call(page: ClientWebSocketResponse, method: str, **params: Any) -> dict[str, Any]:
    """Call a method and return the response; notifications before it are passed over."""
    await page.send_json({"jsonrpc": "2.0", "id": 7, "method": method, "params": params})
    while "id" not in (message := dict(json.loads(await page.receive_str()))):
        pass
    return message
