"""Pages that send too much, read nothing, or show their secret where it does not belong.

Modules: servolink.transports.listeners.http_connections, servolink.transports.listeners.strangers,
servolink.studio.page.
"""

from __future__ import annotations

import asyncio
import base64
import os
import struct
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Any

import pytest
from aiohttp import WSCloseCode, WSMsgType

from servolink.studio.gate import Gate
from servolink.studio.links import Links
from servolink.studio.page import MOST_MESSAGE, MOST_UNREAD
from servolink.studio.server import HEADERS
from servolink.transports import HttpConnection, HttpServing
from tests.open_files import allow_files
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
    monkeypatch.setattr(HttpServing, "HEAD_LIMIT", 0.05)

    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("edit"))
            async with silent(place, begin) as reader:
                assert await reader.read() == b""
            assert (await call(page, "studio.about"))["result"]["version"]

    run(test)


_PAGE = "GET {path} HTTP/1.1\r\nHost: {host}\r\n"
_UPGRADE = (
    "Origin: http://{host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
)
FIRST = {
    "nothing": "",
    "half a head": "GET / HTTP/1.1\r\nHost: ",
    "a request": _PAGE.replace("{path}", "/icon.svg") + "\r\n",
    "a request, and reads nothing": _PAGE.replace("{path}", "/") + "\r\n" * 2,
    "a request under another name": "GET / HTTP/1.1\r\nHost: elsewhere\r\n\r\n",
    "a WebSocket without a token": _PAGE.replace("{path}", "/ws")
    + _UPGRADE
    + "Sec-WebSocket-Key: "
    + "A" * 22
    + "==\r\n\r\n",
}


@pytest.mark.parametrize("first", FIRST.values(), ids=FIRST)
def test_connections_without_a_token_are_few_whatever_they_send_first(
    first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    allow_files(monkeypatch, 64)  # 16 strangers

    async def test(place: Place) -> None:
        begin = first.replace("{host}", place.address.removeprefix("http://")).encode()
        token = place.gate.new_token("edit")
        async with place.page() as page, AsyncExitStack() as stack:
            await welcomed(page, token)
            readers = [await stack.enter_async_context(silent(place, begin)) for _ in range(28)]
            for reader in readers[:12]:  # the oldest
                with suppress(ConnectionError):
                    while await reader.read(1 << 16):
                        pass
            later: Any = await stack.enter_async_context(place.page())
            await welcomed(later, token)
            assert (await call(page, "stop"))["result"] == (await call(later, "stop"))["result"] == {}

    run(test)


def test_pages_of_a_link_are_few_and_leave_room_for_the_owner(monkeypatch: pytest.MonkeyPatch) -> None:
    allow_files(monkeypatch, 128)

    async def test(place: Place) -> None:
        place.studio.links = Links(place.gate, 1, ("robot.local",))
        link = place.studio.links.addresses()[0].address.partition("#token=")[2]
        async with AsyncExitStack() as stack:
            pages = [await stack.enter_async_context(place.page()) for _ in range(9)]
            for page in pages[:8]:
                await welcomed(page, link)
            await pages[8].send_json({"token": link})
            message = await pages[8].receive()
            assert (message.type, message.data) == (WSMsgType.CLOSE, WSCloseCode.TRY_AGAIN_LATER)
            assert message.extra == "too many pages are open through this link; close some"
            owner = await stack.enter_async_context(place.page())
            await welcomed(owner, place.gate.new_token("edit"))
            assert (await call(owner, "stop"))["result"] == {}
            await pages[0].close()
            later = await stack.enter_async_context(place.page())
            await welcomed(later, link)

    run(test)


def test_pings_of_a_page_are_answered_and_a_flood_of_them_closes_it() -> None:
    async def test(place: Place) -> None:
        async with place.http.ws_connect(
            f"{place.address}/ws", headers={"Origin": place.address}, autoping=False
        ) as page:
            await welcomed(page, place.gate.new_token("edit"))
            await page.ping(b"x")
            await page.ping()
            assert (await page.receive()).type is WSMsgType.PONG
            assert (await page.receive()).type is WSMsgType.CLOSE

    run(test)


WRONG = {
    "a path of 64 kB": b"GET /" + b"a" * 65536 + b" HTTP/1.1\r\nHost: HOST\r\n\r\n",
    "a header of 64 kB": b"GET / HTTP/1.1\r\nHost: HOST\r\nX: " + b"a" * 65536 + b"\r\n\r\n",
    "no protocol": b"hello\r\n\r\n",
    "the beginning of TLS": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
    "a control character in a header": b"GET / HTTP/1.1\r\nHost: HOST\r\nX: \x00\r\n\r\n",
    "two lengths": b"GET / HTTP/1.1\r\nHost: HOST\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n",
    "a chunk without a length": b"GET / HTTP/1.1\r\nHost: HOST\r\nTransfer-Encoding: chunked\r\n\r\nZZ\r\n\r\n",
}


@pytest.mark.parametrize("request_", WRONG.values(), ids=WRONG)
def test_a_request_that_is_malformed_or_too_long_has_our_headers_and_leaves_no_trace(
    request_: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.handler.filters.clear()  # aiohttp logs tracebacks under its own name

    async def test(place: Place) -> None:
        host = place.address.removeprefix("http://")
        async with silent(place, request_.replace(b"HOST", host.encode())) as reader:
            response = (await reader.readuntil(b"\r\n\r\n")).decode()
        assert response.startswith(("HTTP/1.0 400 ", "HTTP/1.1 400 "))
        assert {f"{name}: {text}" for name, text in HEADERS.items()} <= set(response.split("\r\n"))

    run(test)
    assert [record for record in caplog.records if record.name.startswith(("aiohttp", "servolink"))] == []


def test_a_request_that_fails_in_the_studio_is_logged_and_has_our_headers(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Gate, "is_ours", lambda *_: 1 / 0)

    async def test(place: Place) -> None:
        async with place.http.get(f"{place.address}/") as response:
            assert response.status == 500
            assert HEADERS.items() <= dict(response.headers).items()
            assert "Traceback" not in await response.text()

    run(test)
    assert "a request for '/' failed" in caplog.text
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("first", ["a request", "a WebSocket without a token"])
def test_a_connection_that_ends_before_its_response_leaves_no_trace(
    first: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.handler.filters.clear()  # as above

    async def aborted(connection: HttpConnection) -> None:
        assert connection.transport is not None
        connection.transport.abort()

    monkeypatch.setattr(HttpConnection, "heard", aborted)

    async def test(place: Place) -> None:
        host = place.address.removeprefix("http://")
        async with silent(place, FIRST[first].replace("{host}", host).encode()) as reader:
            with suppress(ConnectionResetError):
                assert await reader.read() == b""

    run(test)
    assert [record for record in caplog.records if record.name.startswith(("aiohttp", "servolink"))] == []


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
            flooding._line.send = lambda _: asyncio.Event().wait()  # as long as nothing is read
            await welcomed(other, token)
            for _ in range(4 * MOST_UNREAD):
                await page.send_json({"jsonrpc": "2.0", "id": 1, "method": "studio.about"})
            assert (await call(other, "stop"))["result"] == {}
            while (await page.receive()).type is WSMsgType.TEXT:
                pass
            assert flooding not in place.studio.pages
            assert flooding._responses.qsize() <= 2 * MOST_UNREAD

    run(test)
