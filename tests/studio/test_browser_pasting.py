"""Motions are copied on one robot and pasted on another through the clipboard of the system, in a real browser."""

from __future__ import annotations

from typing import Any

import pytest

from servolink import sync
from servolink.protocol import ServoParameter
from tests.studio.browser import SIZES, Studio, found_by_axe, go, in_browser, new_profile, opened, running
from tests.studio.node_tools import needs_npm

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


@needs_npm
def test_a_macro_is_pasted_on_another_robot_with_its_servos_matched_by_name(
    studio: Studio, browser: Any, axe: str
) -> None:
    before = studio.board.export_project()
    (up,) = [action for action in before.actions if action.action_caption == "Arm up"]
    degrees = {step.servo_id: int(step.degree) for step in up.steps}
    profile = new_profile(browser)
    profile.grant_permissions(["clipboard-read", "clipboard-write"])
    with (
        running("--board", "virtual://?servos=6", "studio") as url,
        sync.connect("share://virtual-2") as arm,
        opened(browser, studio.url, profile=profile) as page,
    ):
        arm.add_servo_parameters([ServoParameter(3, 0, "R arm"), ServoParameter(5, 0, "r  elbow")])
        go(page, "Macros")
        page.locator(".mrow").filter(has_text="Wave").click()
        page.locator(".insp").get_by_role("button", name="More").first.click()
        page.get_by_role("menuitem", name="Copy for another robot").click()
        expect(page.get_by_text("Copied")).to_be_visible()
        with opened(browser, url, profile=profile) as there:
            go(there, "Actions")
            there.get_by_role("button", name="Paste from another robot").click()
            dialog = there.get_by_role("dialog")
            expect(dialog.get_by_text("1 servo has no match")).to_be_visible()
            expect(dialog.get_by_label("R shoulder")).to_have_value("none")
            expect(dialog.get_by_label("R arm")).to_have_value("3")
            expect(dialog.get_by_label("R elbow")).to_have_value("5")
            there.evaluate(axe)
            for width, height in SIZES.values():
                there.set_viewport_size({"width": width, "height": height})
                assert there.evaluate("document.documentElement.scrollWidth <= innerWidth")
                assert found_by_axe(there) == []
            there.set_viewport_size({"width": 1440, "height": 900})
            dialog.get_by_label("Time").fill("200")
            dialog.get_by_label("Time").press("Enter")
            dialog.get_by_role("button", name="Add 3 actions and 1 macros").click()
            there.locator(".pose").filter(has_text="Arm up").click()
            expect(there.get_by_label("Target of R arm", exact=True)).to_have_value(
                f"{degrees[2]}°".replace("-", "\u2212")
            )
            expect(there.get_by_label("Target of r  elbow", exact=True)).not_to_have_value("")
            go(there, "Macros")
            expect(there.locator(".mrow")).to_have_count(1)
            expect(there.locator(".mrow")).to_contain_text("Wave")
        assert not arm.actions()  # the board has nothing before the project is written


def test_what_was_not_copied_here_is_refused_and_can_be_pasted_by_hand(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:  # without a permission for the clipboard
        go(page, "Macros")
        page.get_by_role("button", name="Paste from another robot").click()
        field = page.get_by_label("Paste here what was copied")
        field.fill('<img src=x onerror="alert(1)">{"kind": "servolink motions", "version": 1}')
        expect(page.get_by_text("This was not copied in the studio")).to_be_visible()
        servos = '[{"id": 1, "caption": "<b>R shoulder</b>\\u202e", "part": ""}]'
        steps = '[{"servo_id": 1, "degree": 5, "interval_ms": 100}]'
        actions = f'[{{"action_id": 1, "action_caption": "<i>x</i>", "steps": {steps}}}]'
        field.fill(
            f'{{"kind": "servolink motions", "version": 1, "servos": {servos}, "actions": {actions}, "macros": []}}'
        )
        dialog = page.get_by_role("dialog")
        expect(dialog.get_by_text("<i>x</i>").first).to_be_visible()
        expect(dialog.get_by_text("<b>R shoulder</b>\\u202e").first).to_be_visible()
        dialog.get_by_label("<b>R shoulder</b>").select_option(label="R shoulder")
        dialog.get_by_role("button", name="Add 1 actions").click()
        go(page, "Actions")
        expect(page.locator(".pose").filter(has_text="<i>x</i>")).to_have_count(1)
