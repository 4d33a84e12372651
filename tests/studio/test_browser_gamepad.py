"""A gamepad presses the buttons in a real browser: macros run in Robot mode only, and as long as the page watches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.processes import until
from tests.studio.browser import Studio, go, in_browser, is_stopped, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_PLUG = """() => {
  const buttons = Array.from({ length: 16 }, () => ({ pressed: false }));
  window.gamepad = { id: "Pad \\u202e", connected: true, mapping: "standard", buttons };
  navigator.getGamepads = () => [null, window.gamepad];
}"""
_PRESS = "([number, isDown]) => { window.gamepad.buttons[number].pressed = isDown; }"
_FREEZE = "() => { const end = performance.now() + 1500; while (performance.now() < end); }"


def press(page: Any, number: int, *, is_down: bool = True) -> None:
    page.evaluate(_PRESS, [number, is_down])


def buttons_screen(page: Any) -> None:
    go(page, "Buttons")
    expect(page.get_by_role("heading", name="Buttons")).to_be_visible()


def play_hello(page: Any, studio: Studio) -> None:
    """Press the button that runs a macro on the board."""
    buttons_screen(page)
    page.get_by_role("button", name="Robot", exact=True).click()
    before = angles(studio)
    press(page, 0)
    until(lambda: max(abs(angle - before[at]) for at, angle in enumerate(angles(studio))) > 10 or is_stopped(studio))


def angles(studio: Studio) -> list[int]:
    return [int(servo.angle) for servo in studio.board.servos()]


def leave_the_screen(page: Any) -> None:
    page.get_by_role("link", name="Project").click()


def pull_out_the_gamepad(page: Any) -> None:
    page.evaluate("() => { navigator.getGamepads = () => [null]; }")


def freeze(page: Any) -> None:
    page.evaluate(_FREEZE)


STOPPED, FROZEN = "Macros run from here only while", "This page was too slow"


@pytest.mark.parametrize(
    ("end", "said"), [(leave_the_screen, STOPPED), (pull_out_the_gamepad, STOPPED), (freeze, FROZEN)]
)
def test_what_a_gamepad_started_stops_when_nobody_watches(
    studio: Studio, browser: Any, end: Callable[[Any], None], said: str
) -> None:
    with opened(browser, studio.url, patient=end is not freeze) as page:
        page.evaluate(_PLUG)
        play_hello(page, studio)
        end(page)
        expect(page.get_by_text(said)).to_be_visible()
        until(lambda: is_stopped(studio))


def test_a_gamepad_moves_nothing_but_in_robot_mode(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        page.evaluate(_PLUG)
        before = angles(studio)
        buttons_screen(page)
        expect(page.get_by_text("Pad \\u202e")).to_be_visible()
        press(page, 1)
        chosen = page.locator(".padsvg .sel")
        expect(chosen).to_contain_text("2")
        press(page, 0)
        expect(chosen).to_contain_text("1")
        page.get_by_role("button", name="Robot", exact=True).click()  # with both held down
        leave_the_screen(page)
        buttons_screen(page)
        page.wait_for_timeout(500)
        assert angles(studio) == before
        expect(page.get_by_text("You have control")).to_have_count(0)
