"""Every screen as axe-core sees it: names, roles, order and contrast, in both themes and on all sizes."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

from tests.studio.browser import SCREENS, SIZES, Studio, found_by_axe, in_browser, opened, show
from tests.studio.node_tools import needs_npm

pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")

pytestmark = [*in_browser, needs_npm]


def check(studio: Studio, browser: Any, axe: str, size: str, theme: str) -> None:
    with opened(browser, studio.url, size, theme) as page:
        page.emulate_media(reduced_motion="reduce")
        page.evaluate(axe)
        found = {}
        for screen in SCREENS:
            show(page, screen)
            found[screen] = found_by_axe(page)
        show(page, "Board")
        page.get_by_role("button", name="Fit a figure").click()
        found["fit"] = found_by_axe(page)
        if size == "desktop":
            page.keyboard.press("?")
            page.get_by_role("dialog").wait_for()
            found["keys"] = found_by_axe(page)
        assert {screen: each for screen, each in found.items() if each} == {}


@pytest.mark.parametrize(("size", "theme"), [("desktop", "light"), ("phone", "dark")])
def test_every_screen_is_accessible(studio: Studio, browser: Any, axe: str, size: str, theme: str) -> None:
    check(studio, browser, axe, size, theme)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "theme"), sorted({*product(SIZES, ["light", "dark"])} - {("desktop", "light"), ("phone", "dark")})
)
def test_every_screen_is_accessible_everywhere(studio: Studio, browser: Any, axe: str, size: str, theme: str) -> None:
    check(studio, browser, axe, size, theme)
