"""Before the servos are read the page shows no angle and moves nothing: in a real browser."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.studio.browser import LISTEN, Studio, in_browser, new_profile, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

SAMPLE = """const look = () => {
  const row = document.querySelector(".sv");
  if (row !== null) (window.shown ??= []).push(row.querySelector("input").value);
  requestAnimationFrame(look);
};
requestAnimationFrame(look);"""
"""Remembers where the first slider stands in each frame that the browser paints, in `window.shown`."""


class Line:
    """Connection between a page and its studio that can be lost, and that can keep readings back."""

    def __init__(self, profile: Any) -> None:
        """Stand between the studio and each page of `profile`."""
        self._ends: tuple[Any, Any]
        self._readings: list[str] | None = None
        profile.route_web_socket("**/*", self._begin)

    def lose(self) -> None:
        """Lose the connection; the page opens another one, and gets no readings."""
        self._readings = []
        for end in self._ends:
            end.close(code=1012)

    def read(self) -> None:
        """Pass on readings again."""
        readings, self._readings = self._readings or [], None
        for text in readings:
            self._ends[0].send(text)

    def _begin(self, page: Any) -> None:
        studio = page.connect_to_server()
        self._ends = page, studio

        def pass_on(text: str) -> None:
            if self._readings is not None and '"method":"servos"' in text:
                self._readings.append(text)
            else:
                page.send(text)

        studio.on_message(pass_on)


@contextmanager
def unread(browser: Any, url: str) -> Iterator[tuple[Any, Line]]:
    """Yield a page that was connected again and has read no servo since, and its connection."""
    profile = new_profile(browser)
    line = Line(profile)
    with opened(browser, url, profile=profile, loss=True) as page:
        expect(page.get_by_label("Target of servo 2,")).to_be_enabled()
        line.lose()
        expect(page.locator(".sv[data-state=unread]")).to_have_count(16)
        yield page, line


@contextmanager
def doubtful(browser: Any, url: str, servo_id: int) -> Iterator[Any]:
    """Yield a page whose readings of a servo cannot be true."""

    def begin(page: Any) -> None:
        studio = page.connect_to_server()
        studio.on_message(lambda text: page.send(doubted(text)))

    def doubted(text: str) -> str:
        message = json.loads(text)
        if message.get("method") == "servos":
            for servo in message["params"]["servos"]:
                if servo["servo_id"] == servo_id:
                    servo.update(angle=-1, current_raw=-1, temperature_raw=-1, doubt="not measured")
        return json.dumps(message)

    profile = new_profile(browser)
    profile.route_web_socket("**/*", begin)
    with opened(browser, url, profile=profile) as page:
        expect(page.get_by_label(f"Target of servo {servo_id},")).to_be_enabled()
        yield page


def picture_at(slider: Any, end: str) -> bytes:
    """Return the picture of a slider whose value is `min` or `max`."""
    slider.evaluate("(slider, end) => { slider.value = slider[end]; }", end)
    picture: bytes = slider.screenshot()
    return picture


def test_a_slider_stands_nowhere_before_the_first_reading(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        page.add_init_script(SAMPLE)
        page.reload()
        expect(page.get_by_label("Target of servo 1,")).to_be_enabled()
        while page.evaluate("window.shown?.length ?? 0") <= 3:  # `wait_for_function` may need what the page forbids
            page.wait_for_timeout(20)
        assert abs(studio.angle(1)) <= 10
        assert all(abs(int(value)) <= 10 for value in page.evaluate("window.shown"))


def test_nothing_looks_like_an_angle_until_the_servos_are_read_again(studio: Studio, browser: Any) -> None:
    with unread(browser, studio.url) as (page, line):
        slider = page.get_by_label("Target of servo 2,")
        row = page.locator(".sv", has=slider)
        expect(slider).to_be_disabled()
        expect(slider).to_have_attribute("aria-valuetext", "not read yet")
        expect(row.locator("[data-part=angle]")).to_have_text("\u2013")
        for part in ("bar", "now", "current"):
            expect(row.locator(f"[data-part={part}]")).to_be_hidden()
        low, high = (picture_at(slider, end) for end in ("min", "max"))
        assert low == high  # there is no thumb
        expect(page.locator(".insp [data-part=angle]")).to_have_text("\u2013")
        expect(page.get_by_text("as last seen")).to_be_visible()
        line.read()
        expect(slider).to_be_enabled()
        expect(row.locator("[data-part=angle]")).to_contain_text("°")
        assert slider.get_attribute("aria-valuetext") is None


def test_values_that_cannot_be_true_are_marked_on_their_servo_only(studio: Studio, browser: Any) -> None:
    with doubtful(browser, studio.url, 2) as page:
        row = page.locator(".sv", has=page.get_by_label("Target of servo 2,"))
        expect(row.locator("[data-part=angle]")).to_have_text("\u22121° ?")
        expect(row.locator("[data-part=meters]")).to_have_attribute("aria-label", re.compile("^implausible: "))
        expect(page.locator(".sv[data-state=unread]")).to_have_count(1)
        expect(page.locator(".sv[data-state=ready]")).to_have_count(15)
        row.locator("button.nm").click()
        expect(page.locator(".insp [data-part=state]")).to_have_text("implausible")


def test_nothing_is_sent_before_the_servos_are_read(studio: Studio, browser: Any) -> None:
    with unread(browser, studio.url) as (page, line):
        page.evaluate(LISTEN)
        page.locator(".stage .seg").get_by_text("Robot").click()
        slider = page.get_by_label("Target of servo 2,")
        place = slider.bounding_box()
        page.mouse.move(place["x"] + 20, place["y"] + 10)
        page.mouse.down()
        page.mouse.move(place["x"] + 90, place["y"] + 10, steps=5)
        page.mouse.up()
        # As a script of another page might, or a key that was pressed when the slider went out of use.
        slider.evaluate("slider => { slider.value = 40; slider.dispatchEvent(new Event('input')); }")
        line.read()
        expect(slider).to_be_enabled()
        assert not {"move", "lease.take"} & set(page.evaluate("window.sent"))
