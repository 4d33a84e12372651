"""Recording on the screen Live, in a real browser: what the robot did becomes a macro of few keyframes.

Module: servolink.studio.project_methods.
"""

from __future__ import annotations

from typing import Any

import pytest

from tests.studio.browser import Studio, grab, in_browser, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_SERVO = 2
_SEEN = "async () => (await import('./state/seen-movement.js')).seen.value.times.length"
_MADE = """async () => {
  const { draft } = await import("./state/project.js");
  return draft.value.macros.filter(one => one.macro_caption === "Played")
    .map(one => [one.commands.length, one.commands.reduce((sum, each) => sum + each.total_interval_ms, 0)]);
}"""


def test_what_was_done_on_live_becomes_a_macro_of_few_keyframes(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Live")
        page.locator(".stage .seg").get_by_text("Robot").click()
        page.get_by_role("button", name="Record a macro").click()
        x, y = grab(page, _SERVO)
        for step in range(60):
            page.mouse.move(x + 60 * abs(((step / 15) % 2) - 1), y)
            page.wait_for_timeout(40)
        page.mouse.up()
        page.get_by_role("button", name="End the recording").click()
        dialog = page.get_by_role("dialog")
        expect(dialog.get_by_text("keyframes in")).to_be_visible()
        expect(dialog.get_by_label("Distance from what was seen, at most")).to_have_value("1°")
        readings = page.evaluate(_SEEN)
        dialog.get_by_label("Name").fill("Played")
        dialog.get_by_role("button", name="Make the macro").click()
        expect(dialog).to_have_count(0)
        [(count, milliseconds)] = page.evaluate(_MADE)
        assert 3 <= count < readings / 2
        assert 2400 <= milliseconds - 1000 <= 60_000
        page.keyboard.press("Control+z")
        assert page.evaluate(_MADE) == []


def test_a_robot_that_has_not_moved_makes_no_macro(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Live")
        page.get_by_role("button", name="Record a macro").click()
        page.wait_for_timeout(300)
        page.get_by_role("button", name="End the recording").click()
        dialog = page.get_by_role("dialog")
        expect(dialog.get_by_text("Nothing has moved farther than this")).to_be_visible()
        expect(dialog.get_by_role("button", name="Make the macro")).to_be_disabled()
