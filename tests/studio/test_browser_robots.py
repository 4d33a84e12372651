"""Robots are chosen with the mouse, in a real browser: no terminal is needed after the studio has started.

Module: servolink.studio.firmware_methods.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from servolink import sync
from servolink.firmware import ImageSettings, from_uf2, read_settings
from tests.processes import finish, start, until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import (
    PATIENCE,
    SCREENS,
    SIZES,
    Studio,
    found_by_axe,
    grab,
    in_browser,
    new_profile,
    opened,
    running,
    show,
)
from tests.studio.node_tools import needs_npm

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


@pytest.fixture
def nothing(user: Path) -> Iterator[str]:
    """The address of a studio that was started where no board is."""
    with running("studio") as url:
        yield url


@pytest.fixture
def arm(user: Path) -> Iterator[str]:
    """The address of a board with 6 servos, served by another program."""
    program = BoardProgram(user, "--servos", "6")
    yield program.url
    program.kill()


_DENIED = {
    "url": "/dev/ttyACM0",
    "shares": "",
    "name": "",
    "product": "<b>USB</b> servo board",
    "problem": "no permission for /dev/ttyACM0; `servolink doctor` says how to get it",
    "findings": [
        {
            "check": "permissions",
            "observation": "/dev/ttyACM0 belongs to root:dialout with mode 0660; ann is in users",
            "meaning": "only members of dialout may open the port",
            "remedy": "sudo usermod -aG dialout ann\nlog out and in again",
        }
    ],
    "is_ours": False,
    "is_kept": False,
}


@needs_npm
@pytest.mark.parametrize("size", SIZES)
def test_a_port_that_needs_rights_shows_the_command(nothing: str, browser: Any, axe: str, size: str) -> None:
    profile = new_profile(browser, size)

    def with_port(page: Any) -> None:
        studio = page.connect_to_server()
        studio.on_message(lambda text: page.send(text.replace('"boards":[]', f'"boards":[{json.dumps(_DENIED)}]')))

    profile.route_web_socket("**/ws", with_port)
    with opened(browser, nothing, profile=profile) as page:
        expect(page.get_by_text("<b>USB</b> servo board")).to_be_visible()
        expect(page.locator(".cmd code").first).to_have_text("sudo usermod -aG dialout ann")
        assert page.get_by_role("button", name="Connect: ").count() == 0
        page.evaluate(axe)
        assert found_by_axe(page) == []
        no_overflow(page)


def test_another_robot_is_chosen_when_the_program_that_shared_the_board_has_ended(user: Path, browser: Any) -> None:
    sharing = start([sys.executable, "-m", "servolink", "--board", "virtual://?servos=6", "share", "--name", "rex"])
    assert sharing.stdout is not None
    sharing.stdout.readline()
    with running("--board", "share://rex", "studio") as url, opened(browser, url, loss=True) as page:
        expect(page.get_by_label("Target of servo 6,")).to_be_enabled()
        show(page, "Board")
        expect(page.locator(".bd2.on")).to_contain_text("rex")
        finish(sharing, signal.SIGTERM)
        expect(page.get_by_text("The board is not shared any more.")).to_be_visible()
        page.get_by_role("button", name="Choose another robot").click()
        expect(page.get_by_role("heading", name="Choose a robot")).to_be_visible()
        page.get_by_role("button", name="Start a virtual robot").click()
        expect(page.locator(".boardbtn")).to_contain_text("virtual")


_COVERED = """() => [...document.querySelectorAll("button, input, a, select, .toast")].filter(one => {
  const { left, top, width, height } = one.getBoundingClientRect(), x = left + width / 2, y = top + height / 2;
  if (!one.checkVisibility({ visibilityProperty: true })) return false;
  if (width < 2 || x < 0 || y < 0 || x > innerWidth || y > innerHeight) return false;
  const scrolled = one.closest("main, .otherlist")?.getBoundingClientRect();
  if (scrolled && (y < scrolled.top || y > scrolled.bottom)) return false;
  const above = document.elementFromPoint(x, y), bar = above?.closest(".hold");
  if (scrolled && bar && /sticky|fixed/.test(getComputedStyle(bar).position)) return false; // scrolling brings it out
  return !one.contains(above) && !above?.contains(one) && !one.labels?.[0]?.contains(above);
}).map(one => one.outerHTML.slice(0, 120))"""
"""The controls and messages that something else lies over, on the part of the page that is shown."""


def no_overflow(page: Any) -> None:
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_robot_is_connected_and_changed_with_the_mouse_on_all_pages(nothing: str, arm: str, browser: Any) -> None:
    with opened(browser, nothing) as page, opened(browser, nothing, "tablet", "dark") as other:
        for each in (page, other):
            expect(each.get_by_role("heading", name="Choose a robot")).to_be_visible()
            assert each.get_by_role("button", name="STOP Esc").count() == 0
            no_overflow(each)
        page.get_by_role("button", name="Start a virtual robot").click()
        for each in (page, other):
            expect(each.get_by_text("VIRTUAL BOARD")).to_be_visible()
            expect(each.get_by_label("Target of servo 16,")).to_have_count(1)
        other.locator(".stage .seg").get_by_text("Robot").click()
        with sync.connect("share://virtual") as left:
            before = left.servo(2).angle
            x, y = grab(other, 2)  # and never let go
            other.mouse.move(x + 60, y, steps=20)
            until(lambda: left.servo(2).angle > before + 10)
            show(page, "Board")
            page.get_by_role("button", name="Connect: virtual board with 6 servos").click()
            expect(page.locator(".boardbtn")).to_contain_text(arm.rpartition(":")[2])
            expect(page.get_by_text("This is 127-0-0-1")).to_be_visible()
            expect(other.locator(".boardbtn")).to_contain_text(arm.rpartition(":")[2])
            expect(other.get_by_label("Target of servo 6,")).to_have_count(1)
            assert other.get_by_label("Target of servo 7,").count() == 0
            assert not any(servo.is_start for servo in left.servos())
        page.get_by_role("button", name="Disconnect").click()
        for each in (page, other):
            expect(each.get_by_role("heading", name="Choose a robot")).to_be_visible()
            expect(each.get_by_text("is disconnected")).to_be_visible()
        with sync.connect(arm) as board:  # its port is free again
            assert len(board.servos()) == 6
        page.get_by_role("button", name="Use this one: virtual").click()
        expect(page.locator(".boardbtn")).to_contain_text("virtual")


def test_the_firmware_of_a_pico_is_saved_from_the_page(nothing: str, browser: Any) -> None:
    with opened(browser, nothing) as page:
        page.get_by_role("heading", name="Choose a robot").wait_for()
        page.get_by_label("Servos").select_option("6")
        with page.expect_download() as download:
            page.get_by_role("button", name="Save the firmware").click()
        assert download.value.suggested_filename == "servolink-pico.uf2"
        binary = from_uf2(Path(download.value.path()).read_bytes())
        assert read_settings(binary) == replace(ImageSettings(), servos=6)


def test_an_address_is_typed_and_a_wrong_one_says_why(nothing: str, arm: str, browser: Any) -> None:
    with opened(browser, nothing) as page:
        for address, text in (("nonsense", "is neither an address nor a name"), ("tcp://127.0.0.1:1", "127.0.0.1:1")):
            page.get_by_label("Another address").fill(address)
            page.get_by_label("Another address").press("Enter")
            expect(page.get_by_role("alert").filter(has_text=text)).to_be_visible()
        page.get_by_label("Another address").fill(arm)
        page.get_by_role("button", name="Connect", exact=True).click()
        expect(page.get_by_label("Target of servo 6,")).to_have_count(1)


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_a_board_is_shared_with_other_programs_stopped_and_given_back(
    nothing: str, arm: str, browser: Any, size: str
) -> None:
    with opened(browser, nothing, size) as page:
        page.get_by_role("button", name="Share only").click()
        expect(page.get_by_text("shared by this studio")).to_be_visible()
        no_overflow(page)
        with sync.connect(f"share://{arm.removeprefix('tcp://').replace('.', '-').replace(':', '-')}") as board:
            assert len(board.servos()) == 6
            board.set_servo("all", start=True, hold=True)
            page.locator(".stop:visible").click()
            expect(page.get_by_text("Stopped", exact=True)).to_be_visible()
            assert not any(servo.is_start for servo in board.servos())
        page.get_by_role("button", name="Give the port back").click()
        expect(page.get_by_role("button", name="Share only")).to_be_visible(timeout=PATIENCE)
        expect(page.locator(".stop")).to_have_count(0)


@needs_npm
@pytest.mark.parametrize("size", ["phone", "zoomed", "upright"])
def test_a_small_page_reaches_everything_and_covers_nothing(studio: Studio, browser: Any, axe: str, size: str) -> None:
    with opened(browser, studio.url, size) as page:
        page.evaluate(axe)
        expect(page.get_by_label("Target of servo 1,")).to_be_enabled()
        page.locator(".stop:visible").click()
        expect(page.get_by_text("Stopped", exact=True)).to_be_visible()
        assert page.evaluate(_COVERED) == []  # also by the message
        for screen in SCREENS:
            show(page, screen)
            expect(page.locator(".dock > a[aria-current], .others > button[aria-current]")).to_have_text(screen)
            no_overflow(page)
            assert size == "phone" or found_by_axe(page) == [], screen  # `test_accessible` has phones
        page.get_by_role("button", name="More").click()
        page.get_by_role("button", name="Help").click()
        expect(page.get_by_role("dialog")).to_be_visible()
        page.get_by_role("button", name="Close").click()
        page.get_by_role("button", name="More").click()
        page.get_by_label("Language").locator("visible=true").select_option("简体中文")
        expect(page.get_by_role("link", name="实时")).to_be_visible()


@needs_npm
@pytest.mark.parametrize(("size", "theme"), [("desktop", "light"), ("tablet", "dark"), ("phone", "dark")])
def test_the_choice_of_a_robot_is_accessible(
    nothing: str, arm: str, browser: Any, axe: str, size: str, theme: str
) -> None:
    with opened(browser, nothing, size, theme) as page:
        page.emulate_media(reduced_motion="reduce")
        page.evaluate(axe)
        expect(page.get_by_role("button", name="Share only")).to_be_visible()
        assert found_by_axe(page) == []
        no_overflow(page)
