"""A web page can reach every port of this machine, and yet send nothing to a board."""

from __future__ import annotations

import asyncio
import json
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from servolink.hub.doors.frame_doors import tcp_door
from servolink.hub.hub import Hub
from servolink.protocol import Codec, QueryServoListRequest
from servolink.transports import listen
from servolink.virtual import VirtualBoard, serve
from tests.hub.door_hub import GUARD, on_hub, raw_tcp
from tests.processes import start_async

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
LIST = Codec().encode(QueryServoListRequest())
PAGE = """<!doctype html><script>
const frame = new Uint8Array(FRAME);
async function attack(port) {
  const url = `http://127.0.0.1:${port}/`;
  for (const body of [frame, new Blob([frame]), new TextDecoder("latin1").decode(frame)])
    await fetch(url, {method: "POST", mode: "no-cors", body}).catch(() => 0);
  const form = new FormData();
  form.append("file", new Blob([frame]));
  await fetch(url, {method: "POST", mode: "no-cors", body: form}).catch(() => 0);
  await new Promise(resolve => {
    const line = new WebSocket(`ws://127.0.0.1:${port}/`);
    line.onopen = () => line.send(frame);
    line.onclose = resolve;
  });
}
Promise.all(PORTS.map(attack)).then(() => fetch("/done"));
</script>"""


def test_a_post_with_a_frame_in_it_reaches_no_virtual_board() -> None:
    async def main() -> None:
        async with asyncio.timeout(GUARD), serve(VirtualBoard(3), tcp="127.0.0.1:0") as (url,):
            for post in (
                b"POST / HTTP/1.1\r\nContent-Type: text/plain\r\n\r\n" + LIST,
                LIST[:3] + b"x" + LIST,
                b"\x00",
            ):
                with await raw_tcp(url) as program:
                    await program.send(post)
                    assert await program.until_end() == b""

    asyncio.run(main())


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_a_page_in_a_real_browser_reaches_neither_a_hub_nor_a_virtual_board(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        asked = hub.board.stats.frames_sent
        async with tcp_door(hub, "127.0.0.1:0") as door, serve(VirtualBoard(3), tcp="127.0.0.1:0") as (board,):
            ports = [int(url.rpartition(":")[2]) for url in (door, board)]
            await _visit(PAGE.replace("FRAME", json.dumps(list(LIST))).replace("PORTS", json.dumps(ports)), tmp_path)
            assert not hub.programs
            assert hub.board.stats.frames_sent == asked

    on_hub(use)
    shown = [record.getMessage() for record in caplog.records]
    assert len(shown) == 2
    assert all("its first bytes are b'POST / HTTP/1.1\\r'" in text for text in shown)


async def _visit(page: str, folder: Path) -> None:
    """Show a page in the browser until it has done everything."""
    done = asyncio.Event()

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, _: object) -> None:
        body = page.encode()
        head = f"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
        try:
            with suppress(asyncio.IncompleteReadError, ConnectionError):  # browsers connect in advance
                request = await reader.readuntil(b"\r\n\r\n")
                writer.write(head.encode() + body)
                await writer.drain()
                if request.startswith(b"GET /done"):
                    done.set()
        finally:
            writer.close()

    assert CHROMIUM is not None
    options = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run")
    async with listen(converse, "127.0.0.1", 0) as place:
        silent = asyncio.subprocess.DEVNULL
        folder_of_browser = f"--user-data-dir={folder}"
        browser = await start_async(
            CHROMIUM, *options, folder_of_browser, f"http://{place}/", stdout=silent, stderr=silent
        )
        ends = [asyncio.ensure_future(done.wait()), asyncio.ensure_future(browser.wait())]
        try:
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        finally:
            with suppress(ProcessLookupError):
                browser.terminate()
            await browser.wait()
            for end in ends:
                end.cancel()
        if not done.is_set():
            pytest.skip("Chromium does not run here")
