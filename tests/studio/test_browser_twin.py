"""The twin in a real browser: runs with physics, verdicts in lists and plan, and a studio without physics."""

from __future__ import annotations

import re
import signal
import sys
from typing import Any

import pytest

from tests.processes import finish, start
from tests.studio.browser import Studio, in_browser, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_BACKGROUND = 180_000  # milliseconds in which the verdicts are made on the slowest machine
_WITHOUT = "import sys; sys.modules['mujoco'] = None; from servolink.__main__ import main; main()"


def bow_deeply(page: Any) -> None:
    """Change the action Bow so that the robot falls, and show it."""
    show(page, "Actions")
    page.get_by_role("button", name="Bow").first.click()
    for name, degrees in (("R thigh", 88), ("L thigh", -88)):
        field = page.get_by_label(f"Target of {name}", exact=True)
        field.fill(str(degrees))
        field.press("Enter")


def test_the_page_tells_when_and_where_the_twin_falls_and_the_robot_stays(studio: Studio, browser: Any) -> None:
    before = [servo.angle for servo in studio.board.servos()]
    with opened(browser, studio.url) as page:
        bow_deeply(page)
        expect(page.locator(".pose[aria-pressed=true] .verdict.falls")).to_be_visible(timeout=_BACKGROUND)
        page.get_by_role("button", name="Try on the twin").click()
        expect(page.get_by_text("The twin falls at 0.9 s", exact=True)).to_be_visible()
        page.get_by_role("button", name="Close", exact=True).click()
        show(page, "Macros")
        page.locator(".mrow", has_text="Bow and up").click()
        page.get_by_role("button", name="Try on the twin").click()
        expect(page.get_by_text("The twin falls at 0.9 s, in part 2: Stand")).to_be_visible()
        page.locator(".mrow", has_text="Wave").click()
        page.get_by_role("button", name="Try on the twin").click()
        expect(page.get_by_text("On the twin: 0.")).to_be_visible()
        page.get_by_role("button", name="Cancel", exact=True).click()
        expect(page.get_by_role("button", name="Try on the twin")).to_be_visible()
        show(page, "Project")
        expect(page.get_by_text("The twin falls in 3 actions and macros")).to_be_visible(timeout=_BACKGROUND)
        expect(page.get_by_text("Bow and up at 0.9 s, in part 2: Stand")).to_be_visible()
        expect(page.get_by_role("button", name="Write to the board")).to_be_enabled()
    assert [servo.angle for servo in studio.board.servos()] == before


@pytest.mark.usefixtures("user")
def test_without_physics_the_page_offers_no_twin_and_loses_nothing(browser: Any) -> None:
    program = start([sys.executable, "-c", _WITHOUT, "studio", "--demo", "--no-browser"])
    assert program.stdout is not None
    with opened(browser, program.stdout.readline().split()[1]) as page:
        bow_deeply(page)
        expect(page.get_by_role("button", name="Hold to try")).to_be_enabled()
        expect(page.get_by_role("button", name="Try on the twin")).to_have_count(0)
        expect(page.locator(".verdict")).to_have_count(0)
        show(page, "Project")
        expect(page.get_by_role("button", name="Write to the board")).to_be_enabled()
    finish(program, signal.SIGTERM)


def test_a_hand_that_is_dragged_takes_the_arm_along_and_stops_where_it_cannot_go(studio: Studio, browser: Any) -> None:
    stood = [servo.angle for servo in studio.board.servos()]
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        page.locator(".pose").first.click()
        page.get_by_role("button", name="Front").click()
        expect(page.get_by_label("Drag hands, feet and head")).to_be_checked()
        joints = [page.get_by_label(f"Target of L {name}", exact=True) for name in ("shoulder", "arm", "elbow")]
        before = [joint.input_value() for joint in joints]
        box = page.locator(".mid .stage canvas").bounding_box()
        middle, top, height = box["x"] + box["width"] / 2, box["y"], box["height"]
        page.mouse.move(middle + 0.167 * height, top + 0.435 * height)
        page.mouse.down()
        page.mouse.move(middle + 0.31 * height, top + 0.28 * height)
        for joint, was in zip(joints, before, strict=True):
            expect(joint).not_to_have_value(was)
        page.mouse.move(middle + 0.5 * height, top + 0.1 * height)
        expect(page.get_by_text(re.compile(r"^\d+ mm too far away$"))).to_be_visible()
        page.mouse.up()
        expect(page.get_by_text("mm too far away")).to_have_count(0)
        page.get_by_role("button", name="Undo").click()
        assert [joint.input_value() for joint in joints] == before
    assert [servo.angle for servo in studio.board.servos()] == stood
