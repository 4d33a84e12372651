"""The screen Record in a real browser: a file of all that happens, plots that can be frozen, and exports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from servolink.recorder import Event, Recording, ServosRead
from tests.processes import until
from tests.studio.browser import Studio, in_browser, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_DRAWN = "() => document.querySelectorAll('.rec .plot')[0].querySelector('canvas').toDataURL()"


def exported(page: Any, item: str) -> Path:
    """Choose something to export and return the file that the browser saves."""
    page.get_by_role("button", name="Export").click()
    with page.expect_download() as saved:
        page.get_by_role("menuitem", name=item).click()
    return Path(saved.value.path())


def test_recording_marks_and_exports(studio: Studio, browser: Any, tmp_path: Path) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Record")
        expect(page.get_by_role("heading", name="Ready to record")).to_be_visible()
        page.get_by_role("button", name="Record", exact=True).click()
        expect(page.get_by_role("heading", name="Recording 0:")).to_be_visible()
        studio.board.move({2: 20}, speed=90, wait=True)
        page.keyboard.press("k")
        studio.board.move({2: -20}, speed=90, wait=True)
        page.get_by_role("button", name="Mark").click()
        expect(page.get_by_text("marks: 2")).to_be_visible()
        page.get_by_role("button", name="End the recording").click()
        expect(page.get_by_text("The recording is saved")).to_be_visible()

        path = exported(page, "Recording (MCAP)")
        copied = tmp_path / "x.mcap"
        copied.write_bytes(path.read_bytes())
        recording = Recording(copied)
        messages = [entry.message for entry in recording.entries()]
        assert recording.remarks == []
        assert [each.what for each in messages if isinstance(each, Event) and each.kind == "mark"] == [
            "mark 1",
            "mark 2",
        ]
        assert sum(isinstance(each, ServosRead) for each in messages) > 10

        for name in ("None", "All"):
            page.get_by_role("button", name=name, exact=True).click()
        page.locator(".rec fieldset input").first.uncheck()
        head, *rows = exported(page, "What is plotted (CSV)").read_text().splitlines()
        assert head == "seconds,servo_id,angle,current_raw,temperature_raw"
        assert len({row.split(",")[1] for row in rows}) == 15

        page.get_by_role("button", name="Export").click()
        page.get_by_role("menuitem", name="Actions of the marked poses").click()
        expect(page.get_by_text("Poses: 2")).to_be_visible()
        show(page, "Actions")
        expect(page.get_by_text("Recorded 2").first).to_be_visible()


def test_frozen_plots_and_hidden_tabs_draw_nothing(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Record")

        def drawn() -> str:
            return str(page.evaluate(_DRAWN))

        first = drawn()
        until(lambda: drawn() != first)
        page.evaluate("() => Object.defineProperty(document, 'hidden', { configurable: true, get: () => true })")
        page.evaluate("() => new Promise((done) => setTimeout(done, 100))")
        hidden = drawn()
        page.evaluate("() => new Promise((done) => setTimeout(done, 400))")
        assert drawn() == hidden
        page.evaluate("() => delete document.hidden")
        until(lambda: drawn() != hidden)
        page.keyboard.press("f")
        expect(page.get_by_role("button", name="Go on")).to_be_visible()
        page.evaluate("() => new Promise((done) => setTimeout(done, 200))")
        frozen = drawn()
        page.evaluate("() => new Promise((done) => setTimeout(done, 400))")
        assert drawn() == frozen
