"""The page says what went wrong and what to do, in a real browser; and Escape stops whatever may move."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.processes import until
from tests.studio.browser import LISTEN, Studio, in_browser, is_stopped, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


@pytest.mark.parametrize(
    ("typed", "kept", "words"),
    [
        ("999", "170°", "999 is too much: 170° is the most here."),
        ("-999", "\u221220°", "-999 is too little: \u221220° is the least here."),
        ("abc", "9°", "“abc” is not a number: 9° stays."),
    ],
)
def test_a_field_says_why_it_does_not_take_what_was_typed(
    studio: Studio, browser: Any, typed: str, kept: str, words: str
) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        page.get_by_text("Stand", exact=True).first.click()
        field = page.get_by_label("Target of R arm")
        field.fill(typed)
        field.press("Enter")
        expect(field).to_have_value(kept)
        expect(page.get_by_text(words)).to_be_visible()


@pytest.mark.parametrize("content", ["{", "", "1", "\x89PNG"])
def test_a_file_that_is_no_project_is_named_so(studio: Studio, browser: Any, user: Path, content: str) -> None:
    file = user / "photo.json"
    file.write_text(content)
    with opened(browser, studio.url) as page:
        show(page, "Project")
        page.get_by_label("Open a file").set_input_files(file)
        expect(page.get_by_text("photo.json could not be opened")).to_be_visible()
        expect(page.get_by_text("This is not a project file. Choose one that the studio has saved")).to_be_visible()


def test_escape_closes_in_preview_and_stops_all_the_same_when_something_may_move(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        expect(page.get_by_label("Target of servo 1,")).to_be_enabled()
        page.wait_for_function("begun => performance.now() > begun + 1200", arg=page.evaluate("performance.now()"))
        page.evaluate(LISTEN)
        page.keyboard.press("Escape")
        page.keyboard.press("?")
        expect(page.get_by_role("dialog")).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.get_by_role("dialog")).to_have_count(0)
        assert "stop" not in page.evaluate("window.sent")
        assert not is_stopped(studio)
        studio.board.move({2: 60}, duration=20)  # by another program, so slowly that two readings hardly differ
        until(lambda: studio.angle(2) > 10)
        page.keyboard.press("?")
        expect(page.get_by_role("dialog")).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.get_by_role("dialog")).to_have_count(0)
        until(lambda: is_stopped(studio))
        page.get_by_role("button", name="Start all servos").click()
        until(lambda: not is_stopped(studio))
        page.locator(".stage .seg").get_by_text("Robot").click()
        page.keyboard.press("?")
        page.keyboard.press("Escape")
        until(lambda: is_stopped(studio))
