"""Teaching by hand in a real browser: limbs go limp when asked to, and are held before anything else happens."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from servolink.project import ProjectFile
from tests.processes import until
from tests.studio.browser import Studio, go, in_browser, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_RIGHT_ARM = (1, 2, 3)
_FREEZE = """() => setTimeout(() => {
  const end = performance.now() + 6000;
  while (performance.now() < end);
})"""


@contextmanager
def teaching(browser: Any, url: str, size: str = "desktop") -> Iterator[Any]:
    """Open the screen Teach."""
    with opened(browser, url, size) as page:
        go(page, "Teach")
        expect(page.get_by_role("button", name="Right arm")).to_be_visible()
        yield page


def let_go(page: Any, studio: Studio) -> None:
    """Let the right arm go, by the keyboard alone."""
    limb = page.get_by_role("button", name="Right arm")
    if limb.get_attribute("aria-pressed") == "false":
        limb.press("Space")
    page.get_by_role("button", name="Let go").press("Enter")
    until(lambda: limp(studio) == _RIGHT_ARM)
    expect(page.get_by_role("button", name="Take pose")).to_be_focused()


def limp(studio: Studio) -> tuple[int, ...]:
    return tuple(servo.servo_id for servo in studio.board.servos() if not servo.is_hold)


def stopped(studio: Studio) -> tuple[int, ...]:
    return tuple(servo.servo_id for servo in studio.board.servos() if not servo.is_start)


def test_two_poses_become_actions_and_a_macro(studio: Studio, browser: Any) -> None:
    with teaching(browser, studio.url) as page:
        let_go(page, studio)
        first = studio.angle(2)
        page.keyboard.press("Space")
        expect(page.locator(".film .pose")).to_have_count(1)
        page.get_by_role("button", name="Hold again").click()
        until(lambda: limp(studio) == () and stopped(studio) == ())
        page.get_by_role("button", name="You have control").click()
        studio.board.move({2: 40}, duration=0.2, wait=True)
        page.reload()
        expect(page.locator(".film .pose")).to_have_count(1)
        go(page, "Teach")
        until(lambda: not page.get_by_role("button", name="Right arm").is_disabled())
        let_go_when_free(page, studio)
        for _ in range(2):
            page.keyboard.press("Space")
        expect(page.locator(".film .pose")).to_have_count(3)
        page.keyboard.press("u")
        expect(page.locator(".film .pose")).to_have_count(2)
        page.get_by_label("Time to pose 2").fill("2,5 s")
        page.get_by_label("Name").fill("Raise it")
        page.keyboard.press("Enter")
        expect(page.get_by_text("Raise it is in your draft")).to_be_visible()
        until(lambda: limp(studio) == () and stopped(studio) == ())
        go(page, "Project")
        page.get_by_role("button", name="Write").first.click()
        until(lambda: "Raise it" in {macro.macro_caption for macro in studio.board.macros()})
    stored = ProjectFile(studio.board.export_project()).form()["actions"]
    first_steps, second_steps = (one["steps"] for one in stored if one["action_caption"].startswith("Raise it"))
    assert [(step["servo_id"], step["interval_ms"]) for step in second_steps] == [(each, 2500) for each in _RIGHT_ARM]
    assert (first_steps[1]["degree"], second_steps[1]["degree"]) == (first, 40)


def let_go_when_free(page: Any, studio: Studio) -> None:
    until(lambda: page.get_by_text("has control").count() == 0)
    let_go(page, studio)


def test_limbs_are_held_before_another_screen_is_shown(studio: Studio, browser: Any) -> None:
    with teaching(browser, studio.url) as page:
        let_go(page, studio)
        go(page, "Live")
        until(lambda: limp(studio) == () and stopped(studio) == ())


def test_escape_holds_limp_limbs_and_ends_teaching(studio: Studio, browser: Any) -> None:
    with teaching(browser, studio.url) as page:
        let_go(page, studio)
        page.keyboard.press("Escape")
        until(lambda: limp(studio) == ())
        expect(page.get_by_role("button", name="Take pose")).to_be_disabled()
        assert len(stopped(studio)) == 16


def test_limbs_are_held_when_control_is_given_back(studio: Studio, browser: Any) -> None:
    with teaching(browser, studio.url) as page:
        let_go(page, studio)
        page.get_by_role("button", name="You have control").click()
        until(lambda: limp(studio) == ())
        expect(page.get_by_text("The limbs are held again")).to_be_visible()
        assert stopped(studio) == _RIGHT_ARM


@pytest.mark.parametrize("end", ["closed", "frozen"])
def test_limbs_are_held_when_the_page_is_gone(studio: Studio, browser: Any, end: str) -> None:
    with teaching(browser, studio.url) as page:
        let_go(page, studio)
        if end == "frozen":
            page.evaluate(_FREEZE)
            until(lambda: limp(studio) == ())
    until(lambda: limp(studio) == ())
    assert len(stopped(studio)) == 16  # by the hub: the page would only have held the arm


def test_a_page_that_may_only_watch_lets_nothing_go(studio: Studio, browser: Any) -> None:
    with teaching(browser, studio.url) as page:
        studio.board.move({4: 20}, duration=5)
        expect(page.get_by_text("has control").first).to_be_visible()
        page.get_by_role("button", name="Right arm").click()
        expect(page.get_by_role("button", name="Somebody else has control")).to_be_disabled()
        assert limp(studio) == ()


@pytest.mark.parametrize("size", ["desktop", "tablet", "phone"])
def test_the_screen_fits(studio: Studio, browser: Any, size: str) -> None:
    with teaching(browser, studio.url, size) as page:
        let_go(page, studio)
        page.keyboard.press("Space")
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
