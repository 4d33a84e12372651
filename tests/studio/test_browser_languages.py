"""The page in each language, in a real browser: chosen by the browser or a person, whole on every screen and size."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

from tests.studio.browser import SCREENS, SIZES, Studio, found_by_axe, in_browser, new_profile, opened, show
from tests.studio.node_tools import needs_npm

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_LANGUAGES = ("zh-Hans", "zh-Hant")
_CUT = """() => [...document.querySelectorAll("#app *")].filter(each =>
  each.childElementCount === 0 && each.scrollWidth > each.clientWidth + 1 && each.clientWidth > 1
  && getComputedStyle(each).overflowX !== "visible" && /\\p{Script=Han}/u.test(each.textContent)
).map(each => each.outerHTML)"""
"""Texts of the page that are cut; names from the board are Latin here, and may be."""
_MISSING = """() => {
  const context = Object.assign(document.createElement("canvas"), { width: 24, height: 24 })
    .getContext("2d", { willReadFrequently: true });
  context.font = `20px ${getComputedStyle(document.body).fontFamily}`;
  const drawn = text => {
    context.clearRect(0, 0, 24, 24);
    context.fillText(text, 2, 20);
    return context.getImageData(0, 0, 24, 24).data.join();
  };
  const missing = drawn("\\u{E123}");  // of no font: the box that stands for such a character
  return [...new Set(document.body.innerText)].filter(each => /\\p{Script=Han}/u.test(each) && drawn(each) === missing);
}"""


def test_the_browser_chooses_the_language_and_a_person_another(studio: Studio, browser: Any) -> None:
    profile = browser.new_context(locale="zh-TW")
    with opened(browser, studio.url, profile=profile) as page:
        expect(page.get_by_role("link", name="即時")).to_be_visible()
        expect(page.locator("html")).to_have_attribute("lang", "zh-Hant")
        page.get_by_label("語言").select_option("English")
        expect(page.get_by_role("link", name="Live")).to_be_visible()
        expect(page.locator("html")).to_have_attribute("lang", "en")
        page.reload()
        expect(page.get_by_role("link", name="Live")).to_be_visible()


@pytest.mark.slow
@needs_npm
@pytest.mark.parametrize(("language", "size"), list(product(_LANGUAGES, SIZES)))
def test_every_screen_is_whole_in_chinese(studio: Studio, browser: Any, axe: str, language: str, size: str) -> None:
    profile = new_profile(browser, size, locale=language)
    found = {}
    with opened(browser, studio.url, profile=profile) as page:
        page.emulate_media(reduced_motion="reduce")
        page.evaluate(axe)
        for screen in SCREENS:
            show(page, screen, by_address=True)
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), screen
            found[screen] = [*page.evaluate(_CUT), *page.evaluate(_MISSING), *found_by_axe(page)]
    assert {screen: each for screen, each in found.items() if each} == {}
