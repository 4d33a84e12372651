"""STOP over open dialogs, in a real browser, on each size of page: a tap reaches the board as a frame.

Module: servolink.studio.page.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.processes import until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import in_browser, opened, running, show
from tests.studio.wire import wire_to

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_SERVO_STATE = 20030
_STOP_ALL = bytes((0xFF, 0, 1))


def ask_to_let_go(page: Any) -> None:
    show(page, "Live")
    page.get_by_role("button", name="Let go", exact=True).click()


def ask_to_delete(page: Any) -> None:
    show(page, "Board")
    page.get_by_role("button", name="Delete everything …").click()


def show_help(page: Any) -> None:
    page.keyboard.press("?")


_DIALOGS: list[Callable[[Any], None]] = [ask_to_let_go, ask_to_delete, show_help]


@pytest.mark.parametrize(("width", "height"), [(390, 844), (768, 1024), (1440, 900), (720, 450)])
def test_a_tap_on_stop_reaches_the_board_over_each_dialog(user: Path, browser: Any, width: int, height: int) -> None:
    program = BoardProgram(user, "--servos", "16")
    profile = browser.new_context(viewport={"width": width, "height": height}, locale="en-GB", has_touch=True)
    with (
        wire_to(program.url) as wire,
        running("studio", "--board", wire.url) as url,
        opened(browser, url, profile=profile) as page,
    ):
        expect(page.get_by_label("Target of servo 1,")).to_be_enabled()
        stop = page.locator(".stop:visible").bounding_box()
        for ask in _DIALOGS:
            ask(page)
            dialog = page.get_by_role("dialog")
            expect(dialog).to_be_visible()
            before = wire.count(_SERVO_STATE)
            page.touchscreen.tap(stop["x"] + stop["width"] / 2, stop["y"] + stop["height"] / 2)
            until(lambda: _STOP_ALL in wire.sent_of(_SERVO_STATE)[before:])  # noqa: B023 - waits here
            expect(dialog).to_be_visible()
            dialog.get_by_role("button", name="Close").click()
            expect(dialog).to_have_count(0)
    program.kill()


_NO_STORAGE = """() => ["localStorage", "sessionStorage"].forEach(name =>
  Object.defineProperty(window, name, { get() { throw new DOMException("blocked", "SecurityError"); } }))"""


def test_a_page_whose_browser_keeps_nothing_works_and_stops(user: Path, browser: Any) -> None:
    """Cookies are blocked for the site: reading what the browser keeps is an error."""
    program = BoardProgram(user, "--servos", "4")
    profile = browser.new_context(viewport={"width": 1440, "height": 900}, locale="en-GB")
    profile.add_init_script(f"({_NO_STORAGE})()")
    with (
        wire_to(program.url) as wire,
        running("studio", "--board", wire.url) as url,
        opened(browser, url, profile=profile) as page,
    ):
        for _ in range(2):
            expect(page.get_by_label("Target of servo 1,")).to_be_enabled()
            before = wire.count(_SERVO_STATE)
            page.locator(".stop:visible").click()
            until(lambda: _STOP_ALL in wire.sent_of(_SERVO_STATE)[before:])  # noqa: B023 - waits here
            page.reload()
    program.kill()
