"""Programs in the page without a server: they move the virtual robot, and neither loops nor malice harm anybody."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.studio.board_program import BoardProgram
from tests.studio.browser import found_by_axe, in_browser
from tests.studio.node_tools import needs_npm
from tests.studio.page_server import PageServer
from tests.studio.test_browser_page import START, served
from tests.studio.test_browser_ports import connect, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = [*in_browser, pytest.mark.slow, pytest.mark.skipif(shutil.which("npm") is None, reason="npm is needed")]

MOVES = """
import asyncio, servolink
async def main():
    async with servolink.connect() as board:
        await board.move({1: 60}, duration=0.5, wait=True)
        print("arrived")
        await board.move({1: 0}, duration=20, wait=True)
asyncio.run(main())
"""
HANGS = """
import servolink
board = await servolink.connect()
await board.move({1: -60}, duration=20)
print("moving")
while True: pass
"""
BUTTONS = """
import servolink
async with servolink.connect() as board:
    print("waiting")
    async for event in board.button_events():
        print("button", event.button_id, event.kind)
        if event.kind == "up":
            await board.move({1: 30}, duration=0.2, wait=True)
            print("arrived")
            break
"""
HOSTILE = """
import js, pyodide_js
taken = '''fetch XMLHttpRequest WebSocket WebTransport EventSource Request Worker SharedWorker BroadcastChannel
    indexedDB caches cookieStore webkitRequestFileSystem webkitRequestFileSystemSync FontFace
    createImageBitmap importScripts'''
found = [name for name in taken.split() if hasattr(js, name)]
taken = "serial usb hid bluetooth storage locks gpu serviceWorker"
found += [name for name in taken.split() if hasattr(js.navigator, name)]
try:
    js.eval("fetch")
    found.append("eval")
except Exception as error:
    print(type(error).__name__)
await pyodide_js.loadPackage("numpy")
try:
    import numpy
    found.append("a package of the network")
except ImportError:
    pass
print("found", found)
"""


@pytest.fixture
def page(built: tuple[Path, str], browser: Any) -> Iterator[Any]:
    """The screen Code, whose page is under its policy, as kept files are."""
    with served(built[0]) as port:
        page = browser.new_context(locale="en-GB").new_page()
        page.goto(f"http://127.0.0.1:{port}/page/#live")
        expect(page.get_by_text("The studio now works without a network too.")).to_be_visible(timeout=START)
        page.reload()
        assert (
            page.evaluate("performance.getEntriesByName(new URL('vendor/codemirror/codemirror.js', location)).length")
            == 0
        )
        page.get_by_role("link", name="Code").click(timeout=START)
        expect(button(page, "Run")).to_be_enabled(timeout=START)
        yield page
        page.close()


def button(page: Any, name: str) -> Any:
    return page.get_by_role("button", name=name, exact=True)


def run(page: Any, text: str) -> None:
    """Type a program in place of the present one, and run it."""
    write(page, text)
    button(page, "Run").click(timeout=START)


def write(page: Any, text: str) -> None:
    page.locator("input[type=file]").set_input_files(
        {"name": "program.py", "mimeType": "text/x-python", "buffer": text.encode()}
    )
    expect(page.locator(".cm-content")).to_contain_text(text.strip().splitlines()[0])


def printed(page: Any, text: str) -> None:
    expect(page.locator(".printed")).to_contain_text(text, timeout=START)


def is_stopped(page: Any) -> None:
    expect(page.get_by_text("The robot is stopped.")).to_be_visible(timeout=START)


def test_an_example_moves_the_robot_and_ends(page: Any) -> None:
    for name in ("Move and watch", "Store a macro on the board", "Follow a curve", "Move within limits"):
        page.get_by_label("Examples").select_option(label=name)
        button(page, "Run").click(timeout=START)
        expect(page.get_by_text("The program has ended.")).to_be_visible(timeout=START)
        if name == "Follow a curve":
            is_stopped(page)  # as it stops at its end; the next Run starts the servos that the page sees stopped
        expect(button(page, "Run")).to_be_enabled(timeout=START)
    printed(page, "servo 1: 120 degrees is outside its limits -80..80")
    page.get_by_role("link", name="Live").click()
    expect(page.locator(".sv [data-part=angle]").first).to_have_text(re.compile("^45"), timeout=START)


def test_stop_ends_a_program_and_the_next_worker_is_there(page: Any) -> None:
    run(page, HANGS)
    printed(page, "moving")
    is_stopped(page)  # by the dead man, while the program goes on
    expect(page.get_by_text("The program is running.")).to_be_visible()
    while not page.evaluate("import('./state/code.js').then(code => code.isReady.value)"):
        page.wait_for_timeout(100)  # nobody tells, as the button is Stop
    button(page, "Stop").click()
    expect(page.get_by_text("The program was stopped.")).to_be_visible()
    expect(button(page, "Run")).to_be_enabled(timeout=3000)
    run(page, "print('next')")
    printed(page, "next")


def test_stop_of_the_robot_ends_a_program_and_its_movement(page: Any) -> None:
    run(page, MOVES)
    printed(page, "arrived")
    page.locator("button.stop").first.click()
    expect(page.get_by_text("The program was stopped.")).to_be_visible()
    is_stopped(page)
    run(page, MOVES)  # starts the servos again
    printed(page, "arrived")


def test_a_killed_worker_stops_the_robot(page: Any) -> None:
    run(page, MOVES)
    printed(page, "arrived")
    button(page, "Stop").click()
    is_stopped(page)


def test_a_hostile_program_finds_no_ports_no_network_and_no_stores(page: Any) -> None:
    run(page, HOSTILE)
    printed(page, "found []")
    run(page, "import js\nwhile True: js.postMessage('x' * 1000)")
    expect(page.get_by_text("it sent more messages than the page can show")).to_be_visible(timeout=START)
    run(page, "while True: print('x', flush=True)")
    printed(page, "x")
    page.locator("button.stop").first.click()
    expect(page.get_by_text("The program was stopped.")).to_be_visible()


def test_buttons_of_a_robot_at_a_port_steer_a_program(built: tuple[Path, str], browser: Any, tmp_path: Path) -> None:
    presses = tmp_path / "presses.txt"
    presses.write_text("".join(f"{second} press 3\n" for second in range(1, 1000)))
    board = BoardProgram(tmp_path, "--script", str(presses))
    server = PageServer(built[0], board.url)
    try:
        page = opened(browser.new_context(locale="en-GB"), server.url)
        connect(page)
        page.get_by_role("link", name="Code").click()
        expect(button(page, "Run")).to_be_enabled(timeout=START)
        run(page, BUTTONS)
        button(page, "Run it").click()
        for text in ("button 3 press", "button 3 up", "arrived"):
            printed(page, text)
        expect(page.get_by_text("The program has ended.")).to_be_visible()
    finally:
        server.close()
        board.kill()


@needs_npm
def test_an_error_is_told_with_its_line_and_nothing_runs_without_run(page: Any, axe: str) -> None:
    write(page, "print('first')\nprint(second)\n")
    expect(page.locator(".printed")).to_have_text("")
    button(page, "Run").click()
    expect(page.get_by_text("Line 2: A name is used here that the program does not know.")).to_be_visible(timeout=START)
    expect(page.locator(".cm-line.mistake")).to_have_text("print(second)")
    expect(page.get_by_text("NameError: name 'second' is not defined").first).to_be_visible()
    page.evaluate(axe)
    assert found_by_axe(page) == []
    page.reload()
    expect(page.locator(".cm-content")).to_contain_text("print(second)", timeout=START)
    expect(page.locator(".printed")).to_have_text("")
