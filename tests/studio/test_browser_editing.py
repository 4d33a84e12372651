"""Actions and macros in a real browser: what is edited is kept, and the robot moves only while something is held."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.processes import until
from tests.studio.browser import LISTEN, Studio, go, in_browser, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


@contextmanager
def editing(browser: Any, url: str, screen: str, size: str = "desktop") -> Iterator[Any]:
    """Open a screen of the studio when the board was read."""
    with opened(browser, url, size) as page:
        go(page, screen)
        expect(page.locator(".pose, .mrow").first).to_be_visible()
        yield page


def stored(studio: Studio) -> Any:
    return studio.board.export_project()


def target(page: Any, caption: str) -> Any:
    return page.get_by_label(f"Target of {caption}", exact=True)


def test_a_pose_is_edited_and_kept_and_nothing_moves(studio: Studio, browser: Any) -> None:
    before, angles = stored(studio), [servo.angle for servo in studio.board.servos()]
    with editing(browser, studio.url, "Actions") as page:
        page.locator(".pose").filter(has_text="Arm up").click()
        target(page, "R arm").fill("100")
        target(page, "R arm").press("Enter")
        page.get_by_label("Time of R arm").fill("0,9 s")
        page.get_by_label("Time of R arm").press("Enter")
        expect(page.get_by_text(re.compile("not written saved"))).to_be_visible()
        page.reload()
        page.get_by_role("link", name="Actions").click()
        page.locator(".pose").filter(has_text="Arm up").click()
        expect(target(page, "R arm")).to_have_value("100°")
        expect(page.get_by_label("Time of R arm")).to_have_value("0.90 s")
    assert stored(studio) == before
    assert [servo.angle for servo in studio.board.servos()] == angles


def test_a_movement_is_eased_at_the_cost_that_was_shown(studio: Studio, browser: Any) -> None:
    before = stored(studio)
    with editing(browser, studio.url, "Actions") as page:
        page.locator(".pose").filter(has_text="Arm up").click()
        page.get_by_role("button", name="Easing …").click()
        dialog = page.get_by_role("dialog")
        dialog.get_by_role("button", name="Linear").click()
        expect(dialog.get_by_role("button", name="Make 1 actions")).to_be_disabled()
        dialog.get_by_role("button", name="Soft").click()
        expect(dialog.get_by_role("note")).to_contain_text("actions and a macro")  # the answer of the library
        cost = re.search(r"(\d+) actions and a macro, (\d+) bytes", dialog.get_by_role("note").inner_text())
        assert cost is not None
        dialog.get_by_role("button", name="Make").click()
        go(page, "Project")
        page.get_by_role("button", name="Write to the board").click()
        expect(page.get_by_text("Written", exact=True)).to_be_visible()
    after = stored(studio)
    made = [one for one in after.actions if one not in before.actions]
    [macro] = [one for one in after.macros if one not in before.macros]
    assert len(made) == len(macro.commands) == int(cost[1]) > 1
    assert sum(38 + 5 * len(one.steps) for one in made) + 38 + 12 * len(made) == int(cost[2])
    [arm_up] = [one for one in before.actions if one.action_caption == "Arm up"]
    assert {step.servo_id: step.degree for step in made[-1].steps} == {
        step.servo_id: step.degree for step in arm_up.steps
    }


def test_undo_and_redo_reach_over_screens(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page:
        page.locator(".pose").filter(has_text="Arm up").click()
        page.keyboard.press("m")
        expect(target(page, "L arm")).to_be_visible()
        page.get_by_role("link", name="Macros").click()
        page.keyboard.press("Control+z")
        expect(page.get_by_text("Arm up: mirror")).to_be_visible()
        page.get_by_role("link", name="Actions").click()
        expect(target(page, "L arm")).to_have_count(0)
        page.keyboard.press("Control+Shift+Z")
        expect(target(page, "L arm")).to_be_visible()


def test_the_figure_is_posed_by_the_keyboard(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page:
        page.locator(".pose").filter(has_text="Arm up").click()
        page.get_by_role("button", name="R elbow").click()
        before = int(target(page, "R elbow").input_value().rstrip("°"))
        figure = page.locator(".mid .stage canvas")
        figure.press("ArrowRight")
        figure.press("Shift+ArrowRight")
        expect(target(page, "R elbow")).to_have_value(f"{before + 11}°")


def test_a_pose_is_tried_while_it_is_held(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page:
        page.locator(".pose").filter(has_text="Arm up").click()
        goal = int(target(page, "R arm").input_value().rstrip("°"))
        page.get_by_role("button", name="Hold to try").hover()
        page.mouse.down()
        until(lambda: abs(studio.angle(2) - goal) <= 3)
        page.mouse.up()


def test_what_two_pages_edit_is_not_overwritten(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page, editing(browser, studio.url, "Actions") as other:
        page.get_by_label("Name", exact=True).fill("mine")
        page.get_by_label("Name", exact=True).press("Enter")
        expect(other.get_by_label("Name", exact=True)).to_have_value("mine")
        for each, name in ((page, "first"), (other, "second")):
            each.get_by_label("Name", exact=True).fill(name)
        for each in (page, other):
            each.get_by_label("Name", exact=True).press("Enter")
        until(lambda: page.get_by_text("Keep mine").count() + other.get_by_text("Keep mine").count() > 0)
        loser, winner, name = (
            (page, other, "first") if page.get_by_text("Keep mine").count() else (other, page, "second")
        )
        loser.get_by_text("Keep mine").click()
        expect(winner.get_by_label("Name", exact=True)).to_have_value(name)


def test_a_clip_that_is_too_short_to_hit_has_a_number_below(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Macros", "phone") as page:
        page.get_by_role("button", name="Add a pause").click()
        page.get_by_label("Waits").fill("0.01 s")
        page.get_by_label("Waits").press("Enter")
        number = page.locator(".clipno[aria-pressed=true]")
        page.locator(".clip:not(.on)").first.click()
        expect(number).to_have_count(0)
        page.locator(".clipno").last.click()
        expect(number).to_have_count(1)
        assert min(number.bounding_box()[side] for side in ("width", "height")) >= 24
        assert page.locator(".clip.on").bounding_box()["width"] < 10  # as long as the pause
        page.keyboard.press("Delete")
        expect(number).to_have_count(0)


def test_a_macro_is_built_with_the_keyboard_and_by_dragging(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Macros") as page:
        clips = page.locator(".lane.clips .clip")
        first, second = (
            clips.nth(0).get_attribute("title").split(",")[0],
            clips.nth(1).get_attribute("title").split(",")[0],
        )
        clips.nth(0).focus()
        page.keyboard.press("Alt+ArrowRight")
        expect(clips.nth(0)).to_have_attribute("title", beginning(second))
        page.keyboard.press("Control+z")
        expect(clips.nth(0)).to_have_attribute("title", beginning(first))
        count = clips.count()
        page.get_by_role("button", name="Add a pause").click()
        expect(clips).to_have_count(count + 1)
        page.keyboard.press("Delete")
        expect(clips).to_have_count(count)
        place = clips.nth(0).bounding_box()
        right, middle = place["x"] + place["width"], place["y"] + place["height"] / 2
        page.mouse.move(right - 4, middle)
        page.mouse.down()
        page.mouse.move(right + place["width"], middle, steps=8)
        page.mouse.up()
        expect(clips.nth(0)).to_contain_text(" %")
        page.keyboard.press("Control+z")
        expect(clips.nth(0)).not_to_contain_text(" %")


def beginning(name: str) -> re.Pattern[str]:
    return re.compile(f"^{re.escape(name)},")


def test_a_preview_sends_no_movement_and_a_hold_runs_the_draft(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Macros") as page:
        page.evaluate(LISTEN)
        page.get_by_role("button", name="Play the preview").click()
        expect(page.locator(".time")).not_to_contain_text("0.00")
        page.get_by_role("button", name="Pause the preview").click()
        assert not {"move", "run", "lease.take"} & set(page.evaluate("window.sent"))
        page.keyboard.press("Home")
        angles = {servo.servo_id: servo.angle for servo in studio.board.servos()}
        page.get_by_role("button", name="Hold to run on robot").hover()
        page.mouse.down()
        expect(page.get_by_text("The robot moves")).to_be_visible()
        until(lambda: any(abs(servo.angle - angles[servo.servo_id]) > 20 for servo in studio.board.servos()))
        page.mouse.up()
        expect(page.get_by_text("Preview only.")).to_be_visible()
        sent = page.evaluate("window.sent").count("move")
        page.wait_for_timeout(500)
        assert page.evaluate("window.sent").count("move") == sent


@pytest.mark.parametrize("size", ["desktop", "tablet", "phone"])
@pytest.mark.parametrize("screen", ["Actions", "Macros"])
def test_nothing_is_cut_off_at_the_side(studio: Studio, browser: Any, screen: str, size: str) -> None:
    with editing(browser, studio.url, screen, size) as page:
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        hold = page.get_by_role("button", name="Hold to")
        expect(hold).to_be_visible()


def test_what_was_given_up_is_what_was_there_before(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page, editing(browser, studio.url, "Actions") as other:
        mine, theirs = (each.get_by_label("Name", exact=True) for each in (page, other))
        mine.fill("mine")
        mine.press("Enter")
        expect(theirs).to_have_value("mine")
        page.get_by_role("button", name="Undo").click()
        expect(theirs).to_have_value("Stand")
        theirs.fill("theirs")
        theirs.press("Enter")
        page.get_by_role("button", name="Keep mine").click()
        expect(theirs).to_have_value("Stand")


def test_what_is_being_typed_stays_when_somebody_else_edits_the_same(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page, editing(browser, studio.url, "Actions") as other:
        for each in (page, other):
            each.locator(".pose").filter(has_text="Arm up").click()
        for field, text, kept in (("Name", "a na", "a na"), ("Target of R elbow", "4", "4°")):
            mine, theirs = (each.get_by_label(field, exact=True) for each in (page, other))
            mine.fill(text)
            before = target(other, "R arm").input_value()
            target(other, "R arm").press("ArrowDown")
            expect(target(page, "R arm")).not_to_have_value(before)
            expect(mine).to_have_value(text)
            mine.press("Enter")
            expect(mine).to_have_value(kept)
            expect(theirs).to_have_value(kept)


def test_who_drags_what_somebody_else_deletes_is_told_and_drags_nothing_else(studio: Studio, browser: Any) -> None:
    with editing(browser, studio.url, "Actions") as page, editing(browser, studio.url, "Actions") as other:
        first = page.get_by_label("Time of R arm")
        expect(first).to_have_value("0.80 s")
        page.locator(".pose").filter(has_text="Arm up").click()
        edge = page.locator(".step").filter(has_text="R arm").locator(".edge")
        place = edge.bounding_box()
        page.mouse.move(place["x"] + 2, place["y"] + 2)
        page.mouse.down()
        other.locator(".pose").filter(has_text="Arm up").click()
        other.locator(".steps").get_by_role("button", name="More").click()
        other.get_by_role("menuitem", name="Delete").click()
        expect(page.get_by_text("Another page has deleted Arm up")).to_be_visible()
        page.mouse.move(place["x"] - 30, place["y"] + 2, steps=3)
        page.mouse.up()
        expect(first).to_have_value("0.80 s")
        page.get_by_role("button", name="Bring it back").click()
        expect(other.locator(".pose").filter(has_text="Arm up")).to_have_count(1)
