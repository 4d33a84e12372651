"""A server of plain files for a built page, and the line of its stand-in of a serial port to a virtual board."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from threading import Thread
from typing import Any

from aiohttp import web

from servolink.protocol import PACKETS, Codec, FrameParser, Packet

SERIAL = (Path(__file__).with_name("serial_stand_in.js")).read_text(encoding="utf-8")
# A busy machine may keep a page from its beats for a while; that the robot is stopped then is a test of its own.
PATIENT = """Worker.prototype.postMessage = (original => function (message, ...more) {
  const text = Array.isArray(message) ? message[2] : "";
  if (typeof text === "string") message[2] = text.replace('"dead_man":0.35', '"dead_man":30');
  return original.call(this, message, ...more);
})(Worker.prototype.postMessage)"""
_PIECE = 4096


class PageServer:
    """Serves the files of a folder at `url`, and connects `/line` to the board at a TCP address."""

    def __init__(self, folder: Path, board: str = "") -> None:
        self.sent: list[tuple[float, bytes]] = []
        """What the page has sent to the board, and when, in seconds since 1970."""
        self._board = board.removeprefix("tcp://")
        self._files = folder
        self._lines: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = Thread(target=self._loop.run_forever)
        self._thread.start()
        self.url = self._call(self._begin())

    def packets(self, after: float = 0.0) -> list[Packet]:
        """Return the packets that the page has sent to the board since a time."""
        frames = FrameParser().feed(b"".join(data for moment, data in self.sent if moment >= after))
        return [Codec().decode(packet_id, content) for packet_id, content in frames if packet_id in PACKETS]

    def unplug(self) -> None:
        """Cut the line."""
        self._call(self._cut())

    def close(self) -> None:
        """End the server."""
        self._call(self._cut())
        self._call(self._runner.cleanup())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _call(self, doing: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(doing, self._loop).result(30)

    async def _begin(self) -> str:
        app = web.Application()
        app.router.add_get("/line", self._line)
        app.router.add_get("/", self._index)
        app.router.add_static("/", self._files)
        self._runner = web.AppRunner(app, shutdown_timeout=1)
        await self._runner.setup()
        site = web.TCPSite(self._runner, "127.0.0.1", 0)
        await site.start()
        return f"http://127.0.0.1:{self._runner.addresses[0][1]}/"

    async def _index(self, _request: web.Request) -> web.FileResponse:
        return web.FileResponse(self._files / "index.html")

    async def _cut(self) -> None:
        for writer in tuple(self._lines):
            writer.close()

    async def _line(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        host, _, port = self._board.rpartition(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        self._lines.add(writer)
        answers = asyncio.ensure_future(self._answer(reader, socket))
        async for message in socket:
            self.sent.append((time.time(), message.data))
            writer.write(message.data)
        self._lines.discard(writer)
        writer.close()
        answers.cancel()
        return socket

    async def _answer(self, reader: asyncio.StreamReader, socket: web.WebSocketResponse) -> None:
        try:
            while data := await reader.read(_PIECE):
                await socket.send_bytes(data)
        except ConnectionError:
            pass
        await socket.close()
