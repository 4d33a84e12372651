"""Other machines reach the studio through links, until these are revoked: in a real browser, under another name."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from servolink import sync
from tests.processes import finish, start, until
from tests.studio.browser import IN_THE_NETWORK, go, in_browser, new_profile, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


class Classroom(NamedTuple):
    """A studio in a network."""

    here: str
    """The address for the machine of the studio."""
    drive: str
    watch: str


@pytest.fixture
def classroom(user: Path) -> Iterator[Classroom]:
    options = ["--demo", "--no-browser", "--host", "*", "--allow-host", IN_THE_NETWORK]
    program = start([sys.executable, "-m", "servolink", "studio", *options])
    assert program.stdout is not None
    addresses = dict(program.stdout.readline().split() for _ in range(3))
    yield Classroom(addresses["studio"], addresses["drive"], addresses["watch"])
    finish(program, signal.SIGTERM)


def test_links_watch_and_drive_until_they_are_revoked(classroom: Classroom, browser: Any) -> None:
    assert f"http://{IN_THE_NETWORK}:" in classroom.watch
    profiles = [new_profile(browser, size) for size in ("desktop", "tablet", "tablet")]
    with (
        opened(browser, classroom.here, profile=profiles[0]) as here,
        opened(browser, classroom.watch, profile=profiles[1]) as watching,
        opened(browser, classroom.drive, profile=profiles[2]) as driving,
    ):
        expect(watching.get_by_text("This page may only watch.")).to_be_visible()
        assert watching.get_by_label("Target of servo 2,").count() == 0
        expect(driving.get_by_label("Target of servo 2,")).to_be_enabled()
        watching.locator(".stop:visible").click()
        expect(watching.get_by_text("Stopped", exact=True)).to_be_visible()
        with sync.connect("share://virtual") as board:
            until(lambda: not any(servo.is_start for servo in board.servos()))
        driving.get_by_role("link", name="Board").locator("visible=true").click()
        expect(driving.get_by_text("Who is here")).to_be_visible()
        assert driving.get_by_text("Tablets and other machines").count() == 0  # links are given by the machine itself
        here.get_by_role("link", name="Board").click()
        expect(here.get_by_text("Links are not encrypted")).to_be_visible()
        shown = here.locator(".cmd code")
        assert {shown.nth(number).inner_text() for number in range(2)} == {classroom.drive, classroom.watch}
        here.get_by_text(f"QR code for {IN_THE_NETWORK}").first.click()
        expect(here.get_by_role("img", name="QR code for").first).to_be_visible()
        for page, number in ((driving, 0), (watching, 0)):
            here.get_by_role("button", name="Revoke").nth(number).click()
            expect(page.get_by_text("This link has ended.")).to_be_visible()
        here.get_by_role("button", name="New link").last.click()
        until(lambda: shown.count() == 1)
        assert classroom.watch not in shown.inner_text()
        watching.goto(shown.inner_text())  # in the page that has expired
        expect(watching.get_by_text("This page may only watch.")).to_be_visible()


OF_THE_OWNER = {
    "Board": ["Fit a figure", "New link"],
    "Servos": ["Measure", "Turn it the other way"],
    "Record": ["Record"],
}
"""Buttons by screen that change settings and files of the computer."""


def test_a_link_that_drives_is_offered_nothing_of_the_computer(classroom: Classroom, browser: Any) -> None:
    with opened(browser, classroom.here) as here, opened(browser, classroom.drive) as driving:
        here.get_by_role("link", name="Board").click()
        here.get_by_role("button", name="Revoke").last.click()  # so that a new link can be made
        for screen, buttons in OF_THE_OWNER.items():
            for page in (here, driving):
                go(page, screen)
                expect(page.locator(".rail a[aria-current]")).to_have_text(screen)
                page.locator(".screen h1, .screen h2, main h2").first.wait_for()
            for name in buttons:
                expect(here.get_by_role("button", name=name, exact=True)).to_have_count(1)
                expect(driving.get_by_role("button", name=name, exact=True)).to_have_count(0)
        go(driving, "Servos")
        expect(driving.get_by_role("heading", name="Limits", exact=True)).to_be_visible()
        assert driving.get_by_label("Lowest angle").count() == 0


def test_a_page_has_its_new_name_at_once(classroom: Classroom, browser: Any) -> None:
    with opened(browser, classroom.here) as here, opened(browser, classroom.drive) as other:
        for page in (here, other):
            page.get_by_role("link", name="Board").click()
        here.get_by_label("Name of this page").fill("Blue tablet")
        here.get_by_label("Name of this page").press("Enter")
        expect(other.get_by_text("studio: Blue tablet")).to_be_visible()
        here.reload()
        expect(other.get_by_text("studio: Blue tablet")).to_be_visible()


def test_a_page_that_may_only_watch_has_no_control_that_is_not_for_it(classroom: Classroom, browser: Any) -> None:
    with opened(browser, classroom.watch) as page:
        expect(page.get_by_text("This page may only watch.")).to_be_visible()
        expect(page.locator(".sv")).to_have_count(16)
        screens = page.locator(".rail a").all_inner_texts()
        assert {"Teach", "Servos"} & set(screens) == set()
        found = {}
        for screen in screens:
            go(page, screen)
            expect(page.locator(".rail a[aria-current]")).to_have_text(screen)
            page.locator(".screen h1, .screen h2").first.wait_for()
            found[screen] = page.locator("main, header").locator("button:disabled, input:disabled").all_inner_texts()
        assert found == {
            screen: [""] if screen == "Macros" else [] for screen in screens
        }  # the zoom, as far as it goes
        go(page, "Actions")
        assert page.locator(".steps input").count() == 0
        page.keyboard.press("Control+d")
        assert page.get_by_text("not written").count() == 0
