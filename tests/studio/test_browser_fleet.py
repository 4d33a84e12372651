"""A class of boards on one page, in a real browser and with a real broker: states, runs together, and a stop of all."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import pytest

from servolink import sync
from servolink.fleet import BoardNow
from tests.fleet.bridged import TOPICS, far_away
from tests.fleet.mosquitto import Broker, needs_broker
from tests.processes import finish, start, until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import IN_THE_NETWORK, SIZES, found_by_axe, in_browser, opened, running
from tests.studio.classroom import Joined, classroom
from tests.studio.node_tools import needs_npm

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
pytest.importorskip("paho.mqtt", reason="the extra fleet is not installed")
expect = playwright.expect

pytestmark = [*in_browser, *needs_broker]


@pytest.fixture
def broker(user: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Broker]:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(user))
    (user / "servolink").mkdir()
    (user / "servolink/fleet.toml").write_text('[groups]\nfront = ["amy", "cat"]\n', encoding="utf-8")
    found = Broker(user)
    found.start()
    yield found
    found.end()


@pytest.fixture
def pupils(broker: Broker) -> Iterator[Joined]:
    """Two boards on which the teacher may run something, and one that may be watched only."""
    with classroom(broker, amy="run", bob="run", cat="watch") as joined:
        yield joined


def tile(page: Any, name: str) -> Any:
    return page.locator(".tile").filter(has=page.get_by_text(name, exact=True))


def angles(board: sync.Board) -> list[int]:
    return [int(servo.angle) for servo in board.servos()]


def test_a_class_is_seen_runs_together_and_is_stopped(broker: Broker, pupils: Joined, browser: Any) -> None:
    with ExitStack() as stack:
        url = stack.enter_context(running("--board", f"share://{pupils.hubs['amy']}", "studio", "--fleet", broker.url))
        page = stack.enter_context(opened(browser, url))
        boards = {name: stack.enter_context(sync.connect(f"share://{hub}")) for name, hub in pupils.hubs.items()}
        before = {name: angles(board) for name, board in boards.items()}
        page.get_by_role("link", name="Fleet").click()
        expect(page.locator(".tile")).to_have_count(3)
        expect(page.get_by_text("3 of 3 connected")).to_be_visible()
        assert tile(page, "cat").get_by_role("checkbox").count() == 0  # nobody may run anything on it
        page.get_by_role("button", name="front (2)").click()  # amy and cat
        expect(page.get_by_text("1 board chosen")).to_be_visible()
        tile(page, "bob").click()
        what = page.get_by_label("What to run")
        expect(what).to_be_visible()
        what.select_option(label="Arm up (action, 2/2)")
        page.get_by_role("button", name="Run on 2 boards …").click()
        expect(page.get_by_role("alert").filter(has_text="Start Arm up on 2 boards?")).to_contain_text("amy, bob")
        assert {name: angles(board) for name, board in boards.items()} == before  # nothing moves before the answer
        page.get_by_role("button", name="Start on 2 boards").click()
        expect(page.get_by_text("Arm up was started on 2 boards")).to_be_visible()
        expect(tile(page, "amy")).to_contain_text("moved by")
        until(lambda: all(angles(boards[name]) != before[name] for name in ("amy", "bob")))
        assert angles(boards["cat"]) == before["cat"]
        page.get_by_role("button", name="STOP ALL Esc").click()
        expect(page.get_by_text("3 robots stopped")).to_be_visible()
        assert not any(servo.is_start for board in boards.values() for servo in board.servos())
        page.get_by_role("button", name="Run on 2 boards …").click()
        page.get_by_role("button", name="Start on 2 boards").click()
        note = page.get_by_role("status").or_(page.get_by_role("alert"))
        expect(note.filter(has_text="released servos do not move here")).to_contain_text("amy, bob")


def test_a_board_that_cannot_run_holds_the_others_back_until_they_are_started_anyway(
    broker: Broker, pupils: Joined, browser: Any
) -> None:
    with (
        sync.connect(f"share://{pupils.hubs['bob']}") as bob,
        running("studio", "--demo", "--fleet", broker.url) as url,
        opened(browser, url) as page,
    ):
        page.get_by_role("link", name="Fleet").click()
        page.get_by_role("button", name="All shown (2)").click()
        page.get_by_label("What to run").select_option(label="Stand (action, 2/2)")
        bob.delete_action("Stand")  # the list on the page is older
        page.get_by_role("button", name="Run on 2 boards …").click()
        page.get_by_role("button", name="Start on 2 boards").click()
        expect(page.get_by_text("No board was started")).to_be_visible()
        expect(page.get_by_role("alert").filter(has_text="bob:")).to_be_visible()
        page.get_by_role("button", name="Start the other 1").click()
        expect(page.get_by_text("Stand was started on 1 board")).to_be_visible()


def test_pages_opened_through_links_see_the_class_and_stop_it_and_nothing_else(
    broker: Broker, pupils: Joined, browser: Any
) -> None:
    options = ["--demo", "--no-browser", "--host", "*", "--allow-host", IN_THE_NETWORK, "--fleet", broker.url]
    program = start([sys.executable, "-m", "servolink", "studio", *options])
    assert program.stdout is not None
    addresses = dict(program.stdout.readline().split() for _ in range(3))
    for role in ("drive", "watch"):
        with opened(browser, addresses[role], "tablet") as page:
            page.get_by_role("link", name="Fleet").locator("visible=true").click()
            expect(page.locator(".tile")).to_have_count(3)
            assert page.get_by_role("checkbox").count() == 0
            assert page.get_by_text("Run together").count() == 0
            page.keyboard.press("Escape")
            expect(page.get_by_text("3 robots stopped")).to_be_visible()
    with sync.connect(f"share://{pupils.hubs['cat']}") as board:
        assert not any(servo.is_start for servo in board.servos())
    finish(program, signal.SIGTERM)


EVIL = "<img src=x onerror=alert(1)>\u202egro.evil\x1b[2J" + "x" * 3000


def publish(broker: Broker, numbers: Iterable[int], battery: float, tcp: str | None = None) -> None:
    """Publish on a thread of its own: Playwright's event loop runs on this one."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, published(broker, numbers, battery, tcp)).result()


async def published(broker: Broker, numbers: Iterable[int], battery: float, tcp: str | None) -> None:
    """Let boards appear, without anything behind them; the texts of number 7 are hostile."""
    async with far_away(broker, "crowd") as far:
        for number in numbers:
            name, is_evil = f"robot{number:03}", number == 7
            now = BoardNow(
                board=name,
                host=EVIL if is_evil else "laptop",
                version="0.1.0",
                connection="connected",
                allow="run",
                at=0.0,
                battery_percent=battery,
                problems=(EVIL,) if is_evil else (),
                lease=EVIL if is_evil else None,
                tcp="javascript:alert(1)" if is_evil else tcp,
            )
            await far.publish(TOPICS.board(name, "state"), msgspec.json.encode(now), retain=True)
            await far.publish(TOPICS.board(name, "available"), b"online", retain=True)


_COUNT_CHANGES = """() => {
  window.changes = 0;
  const more = (all) => (window.changes += all.length);
  const all = { subtree: true, childList: true, characterData: true };
  new MutationObserver(more).observe(document.querySelector(".tiles"), all);
}"""


@needs_npm
def test_two_hundred_boards_and_hostile_texts_stay_readable(broker: Broker, browser: Any, axe: str) -> None:
    publish(broker, range(200), 80.0)
    with running("studio", "--fleet", broker.url) as url, opened(browser, url) as page:
        expect(page.get_by_role("heading", name="Fleet")).to_be_visible()  # no board is here: the fleet comes first
        expect(page.locator(".tile")).to_have_count(200)
        expect(page.locator(".tile").first).to_contain_text("robot007")  # the one that needs help
        assert page.locator(".tile img").count() == 0
        assert "\u202e" not in page.locator(".tiles").inner_text()
        page.evaluate(axe)
        for width, height in SIZES.values():
            page.set_viewport_size({"width": width, "height": height})
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            assert found_by_axe(page) == []
        page.get_by_role("button", name="1 needs help").click()
        expect(page.locator(".tile")).to_have_count(1)
        page.get_by_role("button", name="1 needs help").click()
        page.get_by_label("Search names").fill("robot19")
        expect(page.locator(".tile")).to_have_count(10)
        page.evaluate(_COUNT_CHANGES)
        publish(broker, [195], 5.0)
        expect(page.locator(".tile").first).to_contain_text("robot195")
        expect(page.locator(".tile").first).to_contain_text("5 %")
        assert page.evaluate("window.changes") < 10  # the other tiles stay as they are


def test_boards_of_the_fleet_are_in_the_list_of_robots(broker: Broker, user: Path, browser: Any) -> None:
    publish(broker, [7], 80.0)
    with running("studio", "--fleet", broker.url) as url, opened(browser, url) as page:
        arm = BoardProgram(user, "--servos", "6")
        publish(broker, [8], 80.0, arm.url)
        expect(tile(page, "robot008")).to_be_visible()
        page.get_by_role("link", name="Board").click()
        expect(page.get_by_role("heading", name="Choose a robot")).to_be_visible()
        unreachable = page.locator(".bd2").filter(has_text="robot007")
        assert unreachable.get_by_role("button", name="Connect").count() == 0
        unreachable.get_by_text("How to connect to it").click()
        expect(unreachable.locator("code")).to_have_text('servolink share --name robot007 --tcp "*:9000"')
        page.get_by_role("button", name="Connect: robot008").click()
        expect(page.locator(".boardbtn")).to_contain_text(arm.url.rpartition(":")[2])
        page.get_by_role("link", name="Live").click()
        expect(page.get_by_label("Target of servo 6,")).to_have_count(1)
        arm.kill()
