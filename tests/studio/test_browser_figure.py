"""The figure is fitted to a robot in a real browser, by what moves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.processes import until
from tests.studio.browser import Studio, go, in_browser, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


def joints_of(figure: dict[str, Any]) -> dict[str, Any]:
    return {joint["id"]: joint for joint in figure["joints"]}


def begin_to_fit(page: Any) -> None:
    page.get_by_role("link", name="Board").click()
    page.get_by_role("button", name="Fit a figure").click()
    page.get_by_label("Next servo").click()


def test_a_servo_moves_a_little_while_it_is_held_and_no_other_one(studio: Studio, browser: Any) -> None:
    before = {servo.servo_id: servo.angle for servo in studio.board.servos()}
    with opened(browser, studio.url) as page:
        begin_to_fit(page)
        page.get_by_role("button", name="servo 2 moves a little").hover()
        page.mouse.down()
        furthest = 0

        def has_turned() -> bool:
            nonlocal furthest
            furthest = max(furthest, studio.angle(2) - before[2])
            return furthest >= 5 and studio.angle(2) < before[2] - 3

        until(has_turned)
        page.mouse.up()
        assert furthest <= 7
        page.get_by_role("button", name="Cancel").click()
        rest = {servo.servo_id: servo.angle for servo in studio.board.servos()}
        assert {**rest, 2: 0} == {**before, 2: 0}


def test_a_fitted_figure_is_kept_shown_everywhere_and_saved_into_files(
    studio: Studio, browser: Any, tmp_path: Path
) -> None:
    with opened(browser, studio.url) as page, opened(browser, studio.url) as other:
        begin_to_fit(page)
        page.get_by_label("Which part moved?").select_option("l_arm")
        page.get_by_role("button", name="The other way").click()
        for label, value in (("Turn the part by", "-15"), ("Lowest angle", "-40"), ("Highest angle", "95")):
            page.get_by_role("textbox", name=label).fill(value)
            page.get_by_role("textbox", name=label).press("Enter")
        page.get_by_role("button", name="Save the figure").click()
        expect(page.get_by_text("The figure is kept for this board")).to_be_visible()
        (kept,) = (tmp_path / "data" / "servolink" / "figures").iterdir()
        joints = joints_of(json.loads(kept.read_bytes()))
        arm = joints["l_arm"]
        assert (arm["servo"], arm["offset"], arm["limits"]) == (2, -15, [-40, 95])
        assert "sign" not in arm  # 1; the template has -1 for the left arm
        assert joints["r_arm"]["servo"] == 5
        slider = other.get_by_label("Target of servo 2,")
        expect(slider).to_have_attribute("max", "95")
        other.reload()
        expect(slider).to_have_attribute("min", "-40")
        page.get_by_role("link", name="Project").click()
        with page.expect_download() as download:
            page.get_by_role("button", name="Save a file").click()
        download.value.save_as(tmp_path / "saved.json")
        assert joints_of(json.loads((tmp_path / "saved.json").read_bytes())["figure"]) == joints
        page.get_by_role("link", name="Board").click()
        page.get_by_role("button", name="Go back to the template").click()
        expect(slider).to_have_attribute("max", "170")
        page.get_by_role("link", name="Project").click()
        page.get_by_label("Open a file").set_input_files(str(tmp_path / "saved.json"))
        expect(slider).to_have_attribute("max", "95")


@pytest.mark.parametrize("size", ["tablet", "phone"])
def test_fitting_is_not_cut_off_at_the_side(studio: Studio, browser: Any, size: str) -> None:
    with opened(browser, studio.url, size) as page:
        go(page, "Board")
        page.get_by_role("button", name="Fit a figure").click()
        expect(page.get_by_role("button", name="Save the figure")).to_be_visible()
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        for name in ("Hexapod", "Next servo", "servo 1 moves a little"):
            place = page.get_by_role("button", name=name).bounding_box()
            assert place["x"] + place["width"] <= page.viewport_size["width"] - 12, name
        expect(page.get_by_role("button", name="STOP Esc").locator("visible=true")).to_be_in_viewport(ratio=1)
