"""The documentation in a browser: what axe-core finds, and what the keyboard reaches, in both themes and on two sizes.

The site is the one that `sphinx-build -n -W docs docs/_build` has built.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from tests.studio.browser import CHROMIUM, OPTIONS, PATIENCE, SIZES, found_by_axe, in_browser
from tests.studio.node_tools import AXE, install, needs_npm

SITE = Path(__file__).parents[1] / "docs/_build"
PAGES = ("index", "how-to/studio", "reference/api/board", "reference/commands/move", "search")

pytestmark = [
    *in_browser,
    needs_npm,
    pytest.mark.skipif(not SITE.exists(), reason="the documentation is not built"),
]


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    return (install(AXE, tmp_path_factory.mktemp("axe")) / "axe-core/axe.min.js").read_text()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield found
        found.close()


def opened(browser: Any, name: str, size: str = "desktop", theme: str = "light") -> Any:
    width, height = SIZES[size]
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=theme, reduced_motion="reduce")
    page.set_default_timeout(PATIENCE)
    page.goto((SITE / f"{name}.html").as_uri())
    return page


@pytest.mark.parametrize(("size", "theme"), [*product(("phone", "desktop"), ("light", "dark"))])
def test_pages_are_accessible(browser: Any, axe: str, size: str, theme: str) -> None:
    found = {}
    for name in PAGES:
        page = opened(browser, name, size, theme)
        page.evaluate(axe)
        found[name] = found_by_axe(page)
        page.close()
    assert {name: each for name, each in found.items() if each} == {}


def test_the_keyboard_opens_the_list_of_pages_on_a_phone(browser: Any) -> None:
    page = opened(browser, "how-to/studio", "phone")
    link = page.get_by_role("link", name="A first lesson")
    assert link.count() == 0, "closed, it is passed"
    page.get_by_role("button", name="Pages").press("Enter")
    link.focus()
    link.press("Enter")
    page.get_by_role("heading", name="A first lesson").wait_for()
    page.close()


def test_the_keyboard_scrolls_long_lines_and_passes_short_ones(browser: Any) -> None:
    page = opened(browser, "reference/commands/move", "phone")
    blocks = page.locator("pre")
    scrolls = "blocks => blocks.map(each => [each.scrollWidth > each.clientWidth, each.tabIndex === 0])"
    page.wait_for_function("document.querySelector('pre[tabindex]')")
    found = blocks.evaluate_all(scrolls)
    assert [True, True] in found
    assert all(scrolling == reached for scrolling, reached in found)
    page.close()


def test_the_search_finds_an_option_of_a_command(browser: Any) -> None:
    page = opened(browser, "index")
    page.get_by_role("search").get_by_label("Search").fill("--soft-start")
    page.keyboard.press("Enter")
    page.locator("#search-results").get_by_role("link", name="servolink-move.--soft-start").click()
    page.get_by_role("heading", name="move", exact=True).wait_for()
    page.close()
