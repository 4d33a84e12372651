"""Boxes on the page, in a real browser: messages move no control, siblings do not overlap, and no text is cut.

Module: servolink.studio.page.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

from tests.processes import until
from tests.studio.browser import SCREENS, SIZES, Studio, in_browser, is_stopped, new_profile, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_LANGUAGES = ("en-GB", "zh-Hans", "zh-Hant")
_ALWAYS = [("desktop", "en-GB"), ("phone", "zh-Hant")]
_REST = sorted({*product(SIZES, _LANGUAGES)} - {*_ALWAYS})

_REMEMBER = """() => {
  const controls = "button, input, select, textarea, a[href], summary, [role=slider], canvas";
  const boxOf = element => { const { x, y, width, height } = element.getBoundingClientRect();
    return [x, y, width, height].map(Math.round).join(" "); };
  const isOfMessage = element => element.closest(".status, dialog") !== null;
  const found = new Map([...document.querySelectorAll(`#app :is(${controls})`)]
    .filter(each => !isOfMessage(each) && each.checkVisibility()).map(each => [each, boxOf(each)]));
  window.moved = () => [...found].filter(([each]) => each.isConnected && each.checkVisibility())
    .filter(([each, box]) => boxOf(each) !== box)
    .map(([each, box]) => `${each.getAttribute("aria-label") ?? each.textContent.trim()}: ${box} -> ${boxOf(each)}`);
  window.gone = () => [...found.keys()].filter(each => !each.isConnected || !each.checkVisibility())
    .map(each => each.getAttribute("aria-label") ?? each.textContent.trim());
  return found.size;
}"""
"""Remembers where each control is; afterwards `moved` and `gone` name the controls that have moved or are gone."""

_LOSE = """async isLost => {
  const { boardState, isRead } = await import("./state/robot.js");
  boardState.value = isLost ? "lost" : "connected";
  if (isLost) isRead.value = false;
}"""
_TOAST = """async () => (await import("./state/toasts.js")).toast({
  title: "A message of some length", detail: "And what it means, in a sentence that needs more lines.".repeat(2),
})"""

_OVERLAPS = """() => {
  const isFlat = element => {
    const style = getComputedStyle(element), { width, height } = element.getBoundingClientRect();
    return ["static", "relative"].includes(style.position) && style.display !== "contents" && width > 1 && height > 1
      && element.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true }) && style.float === "none"
      && !(element instanceof SVGElement && element.tagName !== "svg");
  };
  const found = [];
  for (const parent of document.querySelectorAll("#app, #app *:not(svg *)")) {
    const children = [...parent.children].filter(isFlat).map(each => [each, each.getBoundingClientRect()]);
    for (const [at, [one, a]] of children.entries()) for (const [other, b] of children.slice(at + 1)) {
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (wide > 1.5 && high > 1.5) found.push(`${one.outerHTML.slice(0, 160)} | ${other.outerHTML.slice(0, 160)}`);
    }
  }
  return found;
}"""

_CUT = """() => {  // names of the owner may be cut in clips and lanes of the timeline, which have them as titles

  const context = document.createElement("canvas").getContext("2d");
  const isShort = field => {
    const style = getComputedStyle(field);
    context.font = style.font;
    const room = field.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    return field.checkVisibility() && context.measureText(field.value || field.placeholder).width > room + 1;
  };
  const isText = "input:is(:not([type]), [type=text], [type=search])";
  const fields = [...document.querySelectorAll(`#app ${isText}`)].filter(isShort);
  const texts = [...document.querySelectorAll("#app *")].filter(each => each.childElementCount === 0
    && each.textContent.trim() && each.clientWidth > 1 && each.scrollWidth > each.clientWidth + 1
    && getComputedStyle(each).overflowX !== "visible" && !each.matches(".sr") && each.closest(".clip, .lb") === null);
  return [...fields, ...texts].map(each => each.outerHTML.slice(0, 200));
}"""


def check_messages(studio: Studio, browser: Any, size: str, language: str) -> None:
    found: dict[str, list[str]] = {}
    with opened(browser, studio.url, profile=new_profile(browser, size, locale=language)) as page:
        page.emulate_media(reduced_motion="reduce")
        for screen in SCREENS:
            show(page, screen, by_address=True)
            if screen == "Board":
                page.locator(".conn form").first.wait_for()  # below the list of boards, once they are found
            page.wait_for_timeout(300)  # for what the screen asks of the studio
            assert page.evaluate(_REMEMBER) > 5
            page.locator(".stop:visible").click()
            page.locator(".status .note.warn").wait_for()
            moved = [f"stop: {each}" for each in page.evaluate("moved()")]
            moved += [f"stop, gone: {each}" for each in page.evaluate("gone()")]
            assert is_stopped(studio)
            page.evaluate(_TOAST)
            page.locator(".toast").first.wait_for()
            moved += [f"toast: {each}" for each in page.evaluate("moved()")]
            page.evaluate(_LOSE, True)
            page.locator(".status .note.bad").wait_for()
            moved += [f"loss: {each}" for each in page.evaluate("moved()")]
            page.evaluate(_LOSE, False)
            page.locator(".status .note.warn button:not(.more)").click()
            until(lambda: not is_stopped(studio))
            page.locator(".status .note").first.wait_for(state="hidden")
            moved += [f"start: {each}" for each in page.evaluate("moved()")]
            found[screen] = moved
    assert {screen: each for screen, each in found.items() if each} == {}


def check_siblings(studio: Studio, browser: Any, size: str, language: str) -> None:
    found: dict[str, list[str]] = {}
    with opened(browser, studio.url, profile=new_profile(browser, size, locale=language)) as page:
        page.emulate_media(reduced_motion="reduce")
        for screen in SCREENS:
            show(page, screen, by_address=True)
            page.wait_for_timeout(300)
            found[screen] = [*page.evaluate(_OVERLAPS), *page.evaluate(_CUT)]
    assert {screen: each for screen, each in found.items() if each} == {}


@pytest.mark.parametrize(("size", "language"), _ALWAYS)
def test_messages_and_stop_move_no_control(studio: Studio, browser: Any, size: str, language: str) -> None:
    check_messages(studio, browser, size, language)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "language"), _REST)
def test_messages_and_stop_move_no_control_anywhere(studio: Studio, browser: Any, size: str, language: str) -> None:
    check_messages(studio, browser, size, language)


@pytest.mark.parametrize(("size", "language"), _ALWAYS)
def test_no_siblings_overlap_and_no_text_is_cut(studio: Studio, browser: Any, size: str, language: str) -> None:
    check_siblings(studio, browser, size, language)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "language"), _REST)
def test_no_siblings_overlap_and_no_text_is_cut_anywhere(
    studio: Studio, browser: Any, size: str, language: str
) -> None:
    check_siblings(studio, browser, size, language)
