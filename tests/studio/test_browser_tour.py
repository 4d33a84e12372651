"""Guided first minute in a real browser: each step waits for the real thing, and the tour can be left and begun again.

Module: servolink.studio.start.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.studio.browser import Studio, grab, in_browser, new_profile, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


def step(page: Any, number: int) -> None:
    """Wait for a step of the tour."""
    expect(page.locator(".status .note").get_by_text(re.compile(f"^{number} of 6: "))).to_be_visible()


def test_six_steps_lead_from_a_movement_to_a_stop(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Live")
        page.get_by_role("button", name="Show me, in six steps").click()
        step(page, 1)
        x, y = grab(page, 2)
        page.mouse.move(x + 40, y)
        page.mouse.up()
        step(page, 1)  # a draft moves nothing
        page.get_by_role("button", name="Hold to move").hover()
        page.mouse.down()
        step(page, 2)
        page.mouse.up()
        page.get_by_role("link", name="Go to Actions").click()
        page.locator(".list header button").first.click()
        page.keyboard.type("Mine")
        page.keyboard.press("Enter")
        step(page, 3)
        page.get_by_role("link", name="Go to Macros").click()
        page.get_by_role("button", name="Add a pause").click()
        step(page, 4)
        show(page, "Buttons")
        page.get_by_label("Press", exact=True).select_option(index=2)
        step(page, 5)
        show(page, "Project")
        page.get_by_role("button", name="Write to the board").click()
        step(page, 6)
        page.locator(".stop:visible").click()
        expect(page.get_by_role("button", name="Six steps again")).to_be_visible()


def test_the_tour_is_left_and_begun_again_on_a_phone_too(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url, profile=new_profile(browser, "phone")) as page:
        page.get_by_role("button", name="Show me, in six steps").click()
        step(page, 1)
        page.get_by_role("button", name="Leave").click()
        page.reload()
        page.get_by_role("button", name="Six steps again").click()
        step(page, 1)
