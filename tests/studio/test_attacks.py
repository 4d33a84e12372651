"""Pages that send too much, read nothing, or show their secret where it does not belong."""

from __future__ import annotations

import asyncio
import base64
import os
import struct
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import pytest
from aiohttp import WSMsgType

from servolink.studio import server
from servolink.studio.page import MOST_MESSAGE, MOST_UNREAD
from tests.studio.serving import Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

_TEXT, _END, _MASKED, _LONG, _CLOSE = 0x01, 0x80, 0x80, 127, 0x88
_TOO_LARGE = 1009
_MASK = bytes(4)


async def raw_page(place: Place, path: str = "/ws") -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Open a WebSocket by hand."""
    host = place.address.removeprefix("http://")
    reader, writer = await asyncio.open_connection(*host.split(":"))
    key = base64.b64encode(os.urandom(16)).decode()
    lines = [f"GET {path} HTTP/1.1", f"Host: {host}", f"Origin: {place.address}", "Upgrade: websocket"]
    lines += ["Connection: Upgrade", "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Key: {key}", "", ""]
    writer.write("\r\n".join(lines).encode())
    assert b" 101 " in await reader.readuntil(b"\r\n\r\n")
    return reader, writer


def frame(text: bytes, *, kind: int = _TEXT | _END) -> bytes:
    """Return a WebSocket frame, masked with zeros."""
    return bytes([kind]) + struct.pack(">BQ", _MASKED | _LONG, len(text)) + _MASK + text


async def answer(reader: asyncio.StreamReader) -> bytes:
    """Return the first frame that is not a message."""
    while True:
        kind, size = await reader.readexactly(2)
        if size == 126:
            (size,) = struct.unpack(">H", await reader.readexactly(2))
        content = await reader.readexactly(size)
        if kind == _CLOSE:
            return content


@asynccontextmanager
async def silent(place: Place, begin: bytes = b"") -> AsyncIterator[asyncio.StreamReader]:
    """Connect, and send the beginning of a request at most."""
    reader, writer = await asyncio.open_connection(*place.address.removeprefix("http://").split(":"))
    writer.write(begin)
    yield reader
    writer.close()


@pytest.mark.parametrize("begin", [b"", b"GET / HTTP/1.1\r\nHost: "])
def test_a_connection_that_sends_no_request_is_closed_and_a_page_is_not(
    begin: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "HEAD_LIMIT", 0.05)

    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            async with silent(place, begin) as reader:
                assert await reader.read() == b""
            assert (await call(page, "studio.about"))["result"]["version"]

    run(test)


def test_of_many_connections_that_send_no_request_the_oldest_are_closed() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page, AsyncExitStack() as stack:
            await welcomed(page, place.gate.new_token("edit"))
            readers = [await stack.enter_async_context(silent(place)) for _ in range(server.MOST_SILENT + 5)]
            for reader in readers[:5]:
                assert await reader.read() == b""
            async with place.http.get(f"{place.address}/") as response:
                assert response.status == 200
            assert sum(not reader.at_eof() for reader in readers) >= server.MOST_SILENT - 1
            assert (await call(page, "studio.about"))["result"]["version"]

    run(test)


@pytest.mark.parametrize("is_let_in", [False, True])
def test_a_frame_of_a_gigabyte_is_refused_when_it_is_announced(is_let_in: bool) -> None:
    async def test(place: Place) -> None:
        reader, writer = await raw_page(place)
        if is_let_in:
            writer.write(frame(b'{"token": "%s"}' % place.gate.new_token("edit").encode()))
        writer.write(bytes([_TEXT | _END]) + struct.pack(">BQ", _MASKED | _LONG, 1 << 30) + _MASK)
        assert struct.unpack(">H", (await answer(reader))[:2]) == (_TOO_LARGE,)
        writer.close()

    run(test)


def test_a_message_in_many_frames_is_refused_when_it_is_too_large() -> None:
    async def test(place: Place) -> None:
        reader, writer = await raw_page(place)
        piece = b" " * (MOST_MESSAGE // 8)
        for at in range(9):
            writer.write(frame(piece, kind=0 if at else _TEXT))
        assert struct.unpack(">H", (await answer(reader))[:2]) == (_TOO_LARGE,)
        writer.close()

    run(test)


def test_a_token_in_the_address_opens_nothing_and_is_not_repeated() -> None:
    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        async with place.http.get(f"{place.address}/?token={token}") as page:
            assert token not in str(page.headers) + await page.text()
        address = f"{place.address}/ws?token={token}"
        headers = {"Origin": place.address, "Authorization": f"Bearer {token}", "Cookie": f"token={token}"}
        async with place.http.ws_connect(address, headers=headers) as page:
            await page.send_json({"jsonrpc": "2.0", "id": 1, "method": "stop"})
            message = await page.receive()
            assert (message.type, message.data) == (WSMsgType.CLOSE, 4401)

    run(test)


def test_a_page_that_floods_and_reads_nothing_is_closed_and_others_are_served() -> None:
    async def test(place: Place) -> None:
        token = place.gate.new_token("edit")
        async with place.page() as page, place.page() as other:
            await welcomed(page, token)
            flooding: Any = next(iter(place.studio.pages))
            flooding._messages.send_str = lambda _: asyncio.Event().wait()  # as long as nothing is read
            await welcomed(other, token)
            for _ in range(4 * MOST_UNREAD):
                await page.send_json({"jsonrpc": "2.0", "id": 1, "method": "studio.about"})
            assert (await call(other, "stop"))["result"] == {}
            while (await page.receive()).type is WSMsgType.TEXT:
                pass
            assert flooding not in place.studio.pages
            assert flooding._responses.qsize() <= 2 * MOST_UNREAD

    run(test)
