"""A slow page or line loses nothing that a person did, in a real browser: what is stored shows it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink.support import user_folder
from tests.processes import until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import Studio, go, in_browser, new_profile, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_MARKED = """() => new Promise(done => {
  const button = document.querySelector(".others > button");
  new MutationObserver(() => button.ariaCurrent && done(document.querySelector(".otherlist") === null))
    .observe(button, { attributes: true });
  location.hash = "board";
})"""
"""Shows another screen, and returns whether the list of screens is closed as soon as that screen is marked."""


class Line:
    """The WebSockets of a page, on which requests or their answers can be lost or kept back."""

    def __init__(self, profile: Any) -> None:
        self.lost: set[str] = set()
        """Methods whose requests are lost."""
        self.held: set[str] = set()
        """Methods whose answers are kept back."""
        self.asked: list[str] = []
        self._kept: list[Callable[[], None]] = []
        self._ids: set[int] = set()
        profile.route_web_socket("**/ws", self._route)

    def give(self) -> None:
        """Let the answers through that were kept back."""
        self.held = set()
        for send in self._kept:
            send()

    def _route(self, page: Any) -> None:
        studio = page.connect_to_server()

        def from_page(text: str) -> None:
            message = json.loads(text)
            self.asked.append(method := message.get("method", ""))
            if method in self.held:
                self._ids.add(message["id"])
            if method not in self.lost:
                studio.send(text)

        def from_studio(text: str) -> None:
            message = json.loads(text)
            if self.held and "method" not in message and message.get("id") in self._ids:
                self._kept.append(lambda: page.send(text))
            else:
                page.send(text)

        page.on_message(from_page)
        studio.on_message(from_studio)


@pytest.fixture
def profile(browser: Any) -> Any:
    return new_profile(browser)


@pytest.fixture
def arm(user: Path) -> Iterator[str]:
    """The address of another board, with the content of no project."""
    program = BoardProgram(user, "--servos", "6")
    yield program.url
    program.kill()


def wait(page: Any, holds: Callable[[], object]) -> None:
    """Wait until something holds. What the line of a page carries is carried by calls of the page only."""
    until(lambda: page.evaluate("0") == 0 and holds())


def kept(kind: str, board: str) -> Any:
    """Return what the studio keeps of a board; None for nothing."""
    path = user_folder("data") / kind / f"{board}.json"
    return json.loads(path.read_text()) if path.exists() else None


def add_macro_block(page: Any) -> None:
    """Drag the block of a macro into the program."""
    page.locator(".blocklyToolboxCategory", has_text="Start").click()
    box = page.locator(".blocklyFlyout .blocklyPath[aria-label^=macro]").bounding_box()
    page.mouse.move(box["x"] + 8, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(500, 250, steps=4)
    page.mouse.up()


def types(program: Any) -> list[str]:
    return [block["type"] for stack in (program or {"stacks": []})["stacks"] for block in stack["blocks"]]


@pytest.mark.parametrize("is_lost", [False, True], ids=["answered", "lost"])
def test_blocks_are_kept_when_the_page_is_loaded_again_at_once(studio: Studio, profile: Any, is_lost: bool) -> None:
    line = Line(profile)
    line.lost = {"studio.blocks.save"} if is_lost else set()
    with opened(None, studio.url, profile=profile, loss=True) as page:
        show(page, "Blocks")
        add_macro_block(page)
        page.reload()
        line.lost = set()
        if is_lost:
            show(page, "Blocks")
            expect(page.locator(".blocklyDraggable").locator("visible=true")).to_have_count(1)
        wait(page, lambda: types(kept("blocks", "virtual")) == ["macro"])


def test_blocks_that_were_not_kept_in_time_never_reach_the_next_robot(studio: Studio, arm: str, profile: Any) -> None:
    line = Line(profile)
    line.lost = {"studio.blocks.save"}
    with opened(None, studio.url, profile=profile, loss=True) as page, opened(profile.browser, studio.url) as other:
        show(page, "Blocks")
        show(other, "Board")
        add_macro_block(page)
        expect(page.get_by_text("The board cannot run")).to_be_visible()
        other.get_by_role("button", name="Connect: virtual board with 6 servos").click()
        expect(page.locator(".boardbtn")).to_contain_text(arm.rpartition(":")[2])
        line.lost = set()
        show(page, "Blocks")
        page.locator(".blocklyFlyout").first.wait_for(state="attached")
        assert page.locator(".blocklyDraggable").locator("visible=true").count() == 0
        show(other, "Board")
        other.get_by_role("button", name="Use this one: virtual").click()
        expect(page.locator(".boardbtn")).to_contain_text("virtual")
        show(page, "Blocks")
        wait(page, lambda: types(kept("blocks", "virtual")) == ["macro"])
        folder = user_folder("data") / "blocks"
        assert [path.name for path in folder.iterdir()] == ["virtual.json"]


def test_text_that_is_being_typed_is_kept_when_the_page_is_loaded_again(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        page.locator(".pose").filter(has_text="Arm up").click()
        page.get_by_label("Target of R arm", exact=True).fill("100")
        page.reload()
        page.locator(".pose").filter(has_text="Arm up").click()
        expect(page.get_by_label("Target of R arm", exact=True)).to_have_value("100°")
        wait(page, lambda: kept("drafts", "virtual") is not None)


def test_an_edit_that_only_the_browser_has_outlives_two_reloads(studio: Studio, profile: Any) -> None:
    line = Line(profile)
    line.lost = {"studio.draft.save"}
    with opened(None, studio.url, profile=profile, loss=True) as page:
        show(page, "Actions")
        page.get_by_role("button", name="New action").click()
        page.get_by_label("Name", exact=True).fill("Arm out")
        page.get_by_label("Name", exact=True).press("Enter")
        line.held = {"studio.draft.get"}
        line.asked.clear()
        page.reload()
        wait(page, lambda: "studio.draft.get" in line.asked)
        line.give()
        line.lost = set()
        page.reload()
        expect(page.locator(".pose").filter(has_text="Arm out")).to_be_visible()
        wait(page, lambda: kept("drafts", "virtual") is not None)


def test_an_edit_is_no_conflict_with_its_own_beginning(studio: Studio, profile: Any) -> None:
    line = Line(profile)
    with opened(None, studio.url, profile=profile, loss=True) as page:
        show(page, "Actions")
        page.get_by_role("button", name="New action").click()
        name = page.get_by_label("Name", exact=True)
        line.held = {"studio.draft.save"}
        line.asked.clear()
        name.fill("Arm")
        name.press("Enter")
        wait(page, lambda: "studio.draft.save" in line.asked)
        name.fill("Arm out")
        name.press("Enter")
        page.reload()
        line.held = set()
        expect(page.locator(".pose").filter(has_text="Arm out")).to_be_visible()
        wait(page, lambda: any("Arm out" in json.dumps(one) for one in kept("drafts", "virtual")["records"]))
        assert page.locator(".toast.bad").count() == 0


def test_a_short_press_of_a_nudge_counts_although_the_lease_comes_late(studio: Studio, profile: Any) -> None:
    line = Line(profile)
    with opened(None, studio.url, profile=profile, loss=True) as page:
        show(page, "Servos")
        page.locator(".mrow").nth(5).click()
        page.clock.install()
        was = studio.angle(6)
        for passed in (5000, 700):
            line.held = {"lease.take"}
            page.get_by_role("button", name="+5°", exact=True).click()
            page.clock.fast_forward(passed)
            line.give()
            if passed == 5000:
                expect(page.get_by_role("alert").first).to_contain_text("Nothing moved; press again.")
                assert studio.angle(6) == was
        wait(page, lambda: studio.angle(6) == was + 5)


def test_the_list_of_screens_closes_with_the_screen_and_not_after_it(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url, "phone") as page:
        go(page, "Servos")
        page.locator(".others > button").click()
        page.locator(".otherlist").wait_for()
        page.evaluate("location.hash = 'live'")
        expect(page.locator(".others > button[aria-current]")).to_have_count(0)
        page.locator(".others > button").click()
        assert page.evaluate(_MARKED)
