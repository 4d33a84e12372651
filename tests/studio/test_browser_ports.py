"""A robot at a port of the browser: the built page in Chromium, with a stand-in of its serial ports before a board."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink.protocol import ALL_SERVOS, Codec, ExecuteActionRequest, SetServoParameterRequest, Step
from tests.processes import until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import in_browser
from tests.studio.page_server import PATIENT, SERIAL, PageServer

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = [*in_browser, pytest.mark.skipif(shutil.which("npm") is None, reason="npm is not installed")]

START = 240_000  # milliseconds for Python to start in the page, on the slowest machine
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
MOVE = ExecuteActionRequest((Step(1, 60, 100),))
SOON = 1.0  # seconds: 0.1 on an idle machine; a worker that is busy would take five


@pytest.fixture
def server(built: tuple[Path, str], tmp_path: Path) -> Iterator[PageServer]:
    board = BoardProgram(tmp_path)
    server = PageServer(built[0], board.url)
    yield server
    server.close()
    board.kill()


@pytest.fixture
def page(server: PageServer, browser: Any) -> Any:
    """A page that is connected to the board at its port."""
    page = opened(browser.new_context(), server.url)
    connect(page)
    return page


def opened(context: Any, url: str) -> Any:
    page = context.new_page()
    page.add_init_script(SERIAL)
    page.add_init_script(PATIENT)
    page.goto(f"{url}#board")
    expect(page.get_by_text("VIRTUAL BOARD")).to_be_visible(timeout=START)
    return page


def connect(page: Any) -> None:
    page.get_by_role("button", name="Connect my robot").click(timeout=START)
    expect(page.get_by_text("This is 1a86-7523 now")).to_be_visible(timeout=START)
    expect(page.get_by_text("VIRTUAL BOARD")).to_have_count(0)


def wait_for_stop(server: PageServer, since: float) -> float:
    """Return when the board was sent a stop after a time, in seconds since 1970."""
    frame = Codec().encode(STOP)

    def stops() -> list[float]:
        return [moment for moment, data in server.sent if moment >= since and frame in data]

    until(stops)
    return stops()[0]


def studio_worker(page: Any) -> Any:
    return next(one for one in page.workers if "studio-worker" in one.url)


def test_a_robot_is_connected_moved_unplugged_and_comes_back(page: Any, server: PageServer) -> None:
    page.get_by_role("link", name="Live").click()
    page.get_by_role("button", name="Robot", exact=True).click()
    angle = page.locator(".sv [data-part=angle]").first
    before = angle.inner_text(timeout=START)
    for _ in range(10):
        page.get_by_label("Target of servo 1,").press("ArrowRight", delay=300)
    expect(angle).not_to_have_text(before, timeout=START)
    assert any(packet.is_motion for packet in server.packets())
    server.unplug()
    expect(page.get_by_text("The board is gone.")).to_be_visible(timeout=START)
    page.evaluate("plugIn()")
    expect(page.get_by_text("The board is gone.")).to_have_count(0, timeout=START)


# Chromium freezes no page that is on the screen, and hides none without a screen: the events are those of a real one.
ENDS = {
    "hidden": """() => {
        Object.defineProperty(document, "hidden", { get: () => true, configurable: true });
        document.dispatchEvent(new Event("visibilitychange"));
        delete document.hidden;
    }""",
    "frozen": "() => void document.dispatchEvent(new Event('freeze'))",
    "left": "() => void window.dispatchEvent(new Event('pagehide'))",
}


@pytest.mark.parametrize("how", ["hidden", *(pytest.param(how, marks=pytest.mark.slow) for how in ("frozen", "left"))])
def test_a_page_that_nobody_looks_at_stops_the_robot(how: str, page: Any, server: PageServer) -> None:
    began = time.time()
    page.evaluate(ENDS[how])
    assert wait_for_stop(server, began) - began < SOON
    expect(page.get_by_text("The robot is stopped.")).to_be_visible(timeout=START)


@pytest.mark.slow
def test_a_dead_worker_stops_the_robot_and_another_one_goes_on(server: PageServer, browser: Any) -> None:
    page = browser.new_page()
    page.add_init_script(SERIAL)
    page.goto(f"{server.url}#board")
    connect(page)
    began = time.time()
    studio_worker(page).evaluate("() => void setTimeout(() => { throw new Error('out of memory'); })")
    stopped = wait_for_stop(server, began)
    assert stopped - began < SOON
    while len(server.packets(stopped)) < 2:  # the stop, and queries of the new worker
        page.wait_for_timeout(100)
    expect(page.get_by_text("webserial://1a86:7523").first).to_be_visible(timeout=START)


@pytest.mark.slow
def test_a_second_tab_says_that_another_one_has_the_robot(page: Any, server: PageServer) -> None:
    other = opened(page.context, server.url)
    other.get_by_role("button", name="Connect my robot").click(timeout=START)
    expect(other.get_by_text("another tab of this browser has the robot")).to_be_visible(timeout=START)
    expect(other.get_by_text("VIRTUAL BOARD")).to_be_visible()


def test_a_second_tab_watches_stops_and_takes_over(page: Any, server: PageServer) -> None:
    page.get_by_role("link", name="Live").click()
    page.get_by_role("button", name="Robot", exact=True).click()
    other = page.context.new_page()
    other.add_init_script(f"sessionStorage.setItem('granted', 'yes');{SERIAL}")  # granted to all tabs of the page
    other.goto(f"{server.url}#live")
    expect(other.get_by_text("Another tab of this browser has the robot 1a86-7523.")).to_be_visible(timeout=START)
    other.get_by_role("button", name="Watch").click()
    expect(other.get_by_text("This page may only watch.")).to_be_visible(timeout=START)
    assert not any("worker" in one.url and "beat" not in one.url for one in other.workers)
    assert other.get_by_label("Target of servo 1,").count() == 0
    angle = other.locator(".sv [data-part=angle]").first
    before = angle.inner_text(timeout=START)
    for _ in range(10):
        page.get_by_label("Target of servo 1,").press("ArrowRight", delay=300)
    expect(angle).not_to_have_text(before, timeout=START)
    began = time.time()
    other.locator(".stop:visible").click()
    assert wait_for_stop(server, began) - began < SOON
    for each in (page, other):
        expect(each.get_by_text("The robot is stopped.")).to_be_visible(timeout=START)
    expect(other.get_by_role("button", name="Start all")).to_have_count(0)
    page.close()
    expect(other.get_by_text("The tab with the robot has ended.")).to_be_visible(timeout=START)
    other.get_by_role("button", name="Take over").click()
    expect(other.get_by_label("Target of servo 1,")).to_be_enabled(timeout=START)
    expect(other.get_by_text("VIRTUAL BOARD")).to_have_count(0)


@pytest.mark.slow
def test_a_browser_without_ports_is_told_which_has_them(server: PageServer, browser: Any) -> None:
    page = browser.new_page()
    page.add_init_script("for (const name of ['serial', 'usb', 'hid']) delete Navigator.prototype[name];")
    page.goto(f"{server.url}#board")
    expect(page.get_by_text("This browser cannot reach a robot.")).to_be_visible(timeout=START)
    expect(page.get_by_text("VIRTUAL BOARD")).to_be_visible()


def test_a_stop_does_not_wait_for_a_worker_that_is_busy(page: Any, server: PageServer) -> None:
    expect(page.locator("button.stop").first).to_be_visible()
    move = Codec().encode(MOVE).decode("latin-1")
    studio_worker(page).evaluate(
        """frame => void setTimeout(() => {
        for (let count = 0; count < 100; count++) postMessage(["port.frame", 1, "0! " + frame]);
        const end = performance.now() + 5000;
        while (performance.now() < end);
        }, 200)""",
        move,
    )
    pressed = page.evaluate("""async () => {
        await new Promise(done => setTimeout(done, 300));
        const now = Date.now();
        document.querySelector("button.stop").click();
        return now;
    }""")
    begun = pressed / 1000
    stopped = wait_for_stop(server, begun)
    assert stopped - begun < SOON
    expect(page.get_by_text("The robot is stopped.")).to_be_visible(timeout=START)
    moved = [packet for packet in server.packets() if packet.is_motion]
    assert 0 < len(moved) < 100
    assert not [packet for packet in server.packets(stopped) if packet.is_motion]
    page.get_by_role("button", name="Start", exact=False).last.click()
    expect(page.get_by_text("The robot is stopped.")).to_have_count(0, timeout=START)  # it answers right, and obeys
