"""The main job of the screens Buttons, Project and Board in a real browser, checked on the board by another program."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from servolink.project import Project, load_project
from tests.processes import until
from tests.studio.browser import DEMO, Studio, in_browser, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


def macro_of(studio: Studio, button_id: int) -> int:
    """Return the macro that the board runs when a button is pressed."""
    (table,) = studio.board.export_project().joystick_tables
    return next((one.button_press_macro for one in table.buttons if one.button_id == button_id), 0)


def written(page: Any) -> None:
    """Write the draft to the board."""
    show(page, "Project")
    page.get_by_role("button", name="Write to the board").click()
    expect(page.get_by_text("Written", exact=True)).to_be_visible()


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_a_button_gets_a_macro_and_runs_it(studio: Studio, browser: Any, size: str) -> None:
    with opened(browser, studio.url, size) as page:
        show(page, "Buttons")
        page.get_by_role("button", name=re.compile("^(Button )?7")).click()
        press = page.get_by_label("Press", exact=True)
        dance = press.locator("option").filter(has_text="Dance").get_attribute("value")  # takes 10 s
        press.select_option(value=dance)
        assert macro_of(studio, 7) == 0
        written(page)
        assert macro_of(studio, 7) == int(dance)
        show(page, "Buttons")
        page.locator(".screen .seg").get_by_text("Robot").click()
        angles = [servo.angle for servo in studio.board.servos()]
        page.get_by_role("button", name=re.compile("^(Button )?7")).click()
        until(
            lambda: any(abs(servo.angle - was) > 15 for servo, was in zip(studio.board.servos(), angles, strict=True))
        )
        show(page, "Live")  # leaving the screen stops the robot
        until(lambda: not any(servo.is_start for servo in studio.board.servos()))


def test_a_project_is_opened_written_saved_and_taken_back(studio: Studio, browser: Any, tmp_path: Path) -> None:
    before = studio.board.export_project()
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        page.locator(".pose").filter(has_text="Hands up").click()
        page.get_by_role("button", name="More").first.click()
        page.get_by_role("menuitem", name="Delete").click()
        show(page, "Project")
        expect(page.get_by_text("Hands up").first).to_be_visible()
        assert studio.board.export_project() == before
        with page.expect_download() as saving:
            page.get_by_role("button", name="Save a file").click()
        saving.value.save_as(tmp_path / "saved.servolink.json")
        written(page)
        after = studio.board.export_project()
        assert "Hands up" not in {one.action_caption for one in after.actions}
        assert same(load_project(tmp_path / "saved.servolink.json"), after)
        page.get_by_role("button", name="Roll back …").first.click()
        page.get_by_role("dialog").get_by_role("button", name="Roll back").click()
        until(lambda: same(studio.board.export_project(), before))


def test_servos_are_called_as_was_written(studio: Studio, browser: Any, tmp_path: Path) -> None:
    file = tmp_path / "renamed.servolink.json"
    file.write_text(DEMO.read_text().replace('"R elbow"', '"Third"'))
    with opened(browser, studio.url) as page:
        expect(page.get_by_role("button", name="R elbow")).to_be_visible()
        show(page, "Project")
        page.get_by_label("Open a file").set_input_files(str(file))
        written(page)
        show(page, "Live")
        expect(page.get_by_role("button", name="Third")).to_be_visible()


def same(one: Project, other: Project) -> bool:
    """Return whether two projects hold the same, in whatever order."""
    return all(
        sorted(map(repr, getattr(one, kind))) == sorted(map(repr, getattr(other, kind)))
        for kind in ("actions", "macros", "joystick_tables", "servo_parameters")
    )


def test_the_board_is_examined_and_shows_who_is_here(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Board")
        page.get_by_role("button", name="Examine").click()
        expect(page.get_by_text("Nothing is wrong", exact=True)).to_be_visible()
        field = page.get_by_label("Name of this page, for the others")
        field.fill("Tablet 2")
        field.press("Enter")
        until(lambda: any("Tablet 2" in text for text in page.locator(".conn li, .conn dd, .conn b").all_inner_texts()))


def test_a_macro_is_made_and_written_by_the_keyboard_alone(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        page.keyboard.press("3")
        page.locator(".mrow").first.wait_for()
        press_on(page, "New macro")
        tab_to(page, "Name")
        page.keyboard.press("Control+a")
        page.keyboard.type("By hand")
        page.keyboard.press("Enter")
        for action in ("Stand", "Arm up"):
            press_on(page, "Add an action")
            press_on(page, action)
        press_on(page, "Add a pause")
        assert "By hand" not in {macro.macro_caption for macro in studio.board.macros()}
        page.keyboard.press("8")
        page.get_by_text("By hand").first.wait_for()
        press_on(page, "Write to the board")
        until(lambda: "By hand" in {macro.macro_caption for macro in studio.board.macros()})
    made = next(macro for macro in studio.board.export_project().macros if macro.macro_caption == "By hand")
    assert len(made.commands) == 3


def press_on(page: Any, name: str) -> None:
    tab_to(page, name)
    page.keyboard.press("Enter")


def tab_to(page: Any, name: str) -> None:
    """Press Tab until what is called so has the focus, and can be used."""
    for _ in range(200):
        page.keyboard.press("Tab")
        if page.evaluate(_FOCUSED) == name:
            return
    pytest.fail(f"Tab does not reach {name}")


_FOCUSED = """() => {
  const found = document.activeElement;
  return found.disabled ? "" : (found.ariaLabel ?? found.innerText ?? "").trim();
}"""
