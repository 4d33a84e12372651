"""Focus, undo and redo in a real browser: the next key goes where it belongs, and no state is made that nobody had.

Module: servolink.studio.drafts.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from servolink.studio.drafts import draft_path
from tests.processes import until
from tests.studio.browser import Studio, in_browser, opened, show

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

STEPS = 300
_DRAFT = """async () => {
  const { draft } = await import("./state/project.js");
  return JSON.parse(JSON.stringify(draft.value));
}"""
_LABEL = "async () => (await import('./state/project.js')).undoLabel.value?.[0] ?? null"
_IDS = {"servo_parameters": "servo_id", "actions": "action_id", "macros": "macro_id", "joystick_tables": "table_id"}


def drafted(page: Any) -> Any:
    """Return the draft of a page, in the order of ids: a new record of a free id is last until the board is read."""
    draft = page.evaluate(_DRAFT)
    for kind, number in _IDS.items():
        draft[kind].sort(key=lambda record, number=number: record[number])
    return draft


def test_the_name_of_what_is_added_is_typed_at_once(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        for screen, new, tile in (("Actions", "New action", ".pose"), ("Macros", "New macro", ".mrow")):
            show(page, screen)
            count = page.locator(tile).count()
            page.locator(".list header button").first.click()
            page.keyboard.type("Arm out m g h 1 ?")
            page.keyboard.press("Enter")
            expect(page.locator(f"{tile} b").filter(has_text="Arm out m g h 1 ?")).to_have_count(1)
            assert page.locator(tile).count() == count + 1, new
        show(page, "Buttons")
        page.get_by_role("button", name="New table").click()
        page.keyboard.type("Fair")
        page.keyboard.press("Enter")
        expect(page.locator(".tables .seg button").filter(has_text="Fair")).to_have_count(1)


def test_a_clip_that_is_added_has_the_focus(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Macros")
        count = page.locator(".lane.clips .clip").count()
        page.get_by_role("button", name="Add a pause").click()
        page.keyboard.press("Alt+ArrowLeft")
        page.keyboard.press("Delete")
        expect(page.locator(".lane.clips .clip")).to_have_count(count)


@pytest.mark.parametrize("leave", ["Enter", "Tab"])
def test_undo_is_for_the_edits_unless_a_field_has_unfinished_text(studio: Studio, browser: Any, leave: str) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        page.locator(".pose").filter(has_text="Arm up").click()
        field, name = page.get_by_label("Target of R arm", exact=True), page.get_by_label("Name", exact=True)
        before = field.input_value()
        field.fill("100")
        page.keyboard.press(leave)
        expect(field).to_have_value("100°")
        page.keyboard.press("Control+z")
        expect(field).to_have_value(before)
        page.keyboard.press("Control+Shift+Z")
        expect(field).to_have_value("100°")
        name.press("End")
        page.keyboard.type(" x")
        page.keyboard.press("Control+z")  # of the browser, for what is being typed
        expect(field).to_have_value("100°")


def test_undo_works_on_every_screen(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        before = drafted(page)
        for screen in ("Live", "Actions", "Macros", "Buttons", "Teach", "Record", "Project", "Board", "Servos"):
            show(page, "Actions")
            page.get_by_role("button", name="Take from robot", exact=True).click()
            until(lambda: drafted(page) != before)
            show(page, screen)
            page.keyboard.press("Control+z")
            until(lambda: drafted(page) == before)


def ways_to_edit(page: Any, chance: random.Random) -> dict[str, Callable[[], None]]:
    """Return edits of the screen Actions and of the screen Macros, each by keys or mouse."""

    def time() -> None:
        page.get_by_label("Time for all servos", exact=True).fill(str(chance.randint(20, 400) / 100))
        page.keyboard.press("Enter")

    def rename() -> None:
        page.get_by_label("Name", exact=True).fill(f"name {chance.randint(0, 99)}")
        page.keyboard.press("Enter")

    def delete() -> None:
        page.locator(".steps header .menu > button").click()
        page.get_by_role("menuitem", name="Delete").click()

    def choose() -> None:
        poses = page.locator(".pose")
        poses.nth(chance.randrange(poses.count())).click()

    return {
        "choose": choose,
        "time": time,
        "rename": rename,
        "mirror": page.locator(".toolbar").get_by_role("button", name="Mirror").click,
        "take": page.get_by_role("button", name="Take from robot", exact=True).click,
        "copy": lambda: page.locator(".pose[aria-pressed=true]").press("Control+d"),
        "add": page.locator(".list header button").first.click,
        "delete": delete,
    }


def kept_by_the_library(stored: Any, name: str) -> Any:
    """Return the project on the board with the edits that the library keeps."""
    project = json.loads(json.dumps(stored))
    path = draft_path(name)
    for one in json.loads(path.read_text())["records"] if path.exists() else []:
        kind, number = one["kind"], one["id"]
        if one.get("is_discarded"):
            continue
        if kind not in _IDS:
            project[kind] = one["record"]
            continue
        records = {each[_IDS[kind]]: each for each in project[kind]}
        records.pop(number, None)
        if one.get("record") is not None:
            records[number] = one["record"]
        project[kind] = [records[key] for key in sorted(records)]
    return project


def write(page: Any) -> None:
    """Write the draft to the board."""
    show(page, "Project")
    page.get_by_role("button", name="Write to the board").click()
    expect(page.get_by_text("Written", exact=True)).to_be_visible()


def roll_back(page: Any) -> None:
    """Roll the board back to before the latest writing."""
    page.get_by_role("button", name="Roll back …").first.click()
    page.get_by_role("dialog").get_by_role("button", name="Roll back").click()
    expect(page.get_by_text("Rolled back")).to_be_visible()


def is_rolled_back(page: Any) -> bool:
    """Return whether the step to undo next is a roll back."""
    return bool(page.evaluate(_LABEL) == "project.roll_back")


def is_kept(page: Any, board: str, draft: Any) -> bool:
    """Return whether the library keeps a draft of the board."""
    return bool(kept_by_the_library(stored_on(page), board) == draft)


def test_a_roll_back_is_one_step(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        first = drafted(page)
        page.get_by_role("button", name="Take from robot", exact=True).click()
        second = drafted(page)
        assert second != first
        write(page)
        roll_back(page)
        until(lambda: drafted(page) == first)
        for key, state in (("z", second), ("z", first), ("Shift+Z", second), ("Shift+Z", first)):
            page.keyboard.press(f"Control+{key}")
            assert drafted(page) == state


def test_undo_and_redo_in_any_order_give_no_state_that_nobody_had(studio: Studio, browser: Any, user: Path) -> None:
    chance = random.Random(7)
    with opened(browser, studio.url) as page:
        show(page, "Actions")
        ways = ways_to_edit(page, chance)
        states, at = [drafted(page)], 0
        board = page.evaluate("async () => (await import('./state/robot.js')).welcome.value.name")
        for step in range(STEPS):
            if step in (100, 200):
                ways["add"]()  # so that there is something to write
                states, at = [*states[: at + 1], drafted(page)], at + 1
                write(page)
                roll_back(page)
                until(partial(is_rolled_back, page))
                states, at = [*states[: at + 1], drafted(page)], at + 1
                show(page, "Actions")
                continue
            kind = chance.choice(["undo"] * 5 + ["redo"] * 3 + list(ways))
            if kind == "undo":
                page.keyboard.press("Control+z")
                at = max(0, at - 1)
                assert drafted(page) == states[at], step
            elif kind == "redo":
                page.keyboard.press("Control+Shift+Z")
                at = min(len(states) - 1, at + 1)
                assert drafted(page) == states[at], step
            else:
                ways[kind]()
                if (now := drafted(page)) != states[at]:
                    states, at = [*states[: at + 1], now], at + 1
            if step % 50 == 49:
                until(partial(is_kept, page, board, states[at]))


def stored_on(page: Any) -> Any:
    """Return the project on the board, as the page has read it."""
    return page.evaluate("async () => JSON.parse(JSON.stringify((await import('./state/project.js')).stored.value))")
