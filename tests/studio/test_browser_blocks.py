"""Blocks in a real browser: programs put together with mouse and keyboard reach the board as frames, and run there."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from servolink import sync
from servolink.boards import running_hubs
from servolink.protocol import MacroCommand, Step
from tests.processes import until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import Studio, found_by_axe, go, in_browser, opened, running
from tests.studio.node_tools import needs_npm
from tests.studio.wire import Wire, wire_to

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser

_ADD_ACTION, _ADD_MACRO, _ADD_TABLE = 30030, 30070, 40030
_LOADED = '() => performance.getEntriesByType("resource").filter(({ name }) => name.includes("/blockly/")).length'


class Place(NamedTuple):
    """A page of a studio on an empty board, and the line behind the studio."""

    page: Any
    wire: Wire
    board: sync.Board


@contextmanager
def blocks(browser: Any, url: str, size: str = "desktop") -> Iterator[Any]:
    """Open the screen Blocks."""
    with opened(browser, url, size) as page:
        assert page.evaluate(_LOADED) == 0
        go(page, "Blocks")
        page.locator(".blockspace .blocklyToolbox").wait_for()
        yield page


@pytest.fixture
def place(user: Path, browser: Any) -> Iterator[Place]:
    program = BoardProgram(user, "--servos", "4")
    with wire_to(program.url) as wire, running("studio", "--board", wire.url) as url:
        [hub] = running_hubs()
        with sync.connect(hub.url) as board, blocks(browser, url) as page:
            yield Place(page, wire, board)
    program.kill()


def drag(page: Any, category: str, name: str, x: float, y: float) -> None:
    """Drag a block out of the list to a place on the page."""
    page.locator(".blocklyToolboxCategory", has_text=category).click()
    box = page.locator(f".blocklyFlyout .blocklyPath[aria-label^={name}]").bounding_box()
    page.mouse.move(box["x"] + 8, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(x, y, steps=6)
    page.mouse.up()


def type_into(page: Any, text: str, new: str) -> None:
    """Write into the field of a block that shows a text."""
    page.locator(".blocklyField", has_text=re.compile(f"^{text}$")).locator("visible=true").click()
    field = page.locator(".blocklyWidgetDiv .blocklyHtmlInput")
    field.fill(new)
    field.press("Enter")


def write(page: Any) -> None:
    """Make the records, and write them to the board."""
    page.get_by_role("button", name="Make actions and macros").click()
    expect(page.get_by_text("The draft has what these blocks make.")).to_be_visible()
    go(page, "Project")
    page.get_by_role("button", name="Write").first.click()


def test_blocks_put_together_with_the_mouse_run_on_the_board(place: Place) -> None:
    page, wire, board = place
    drag(page, "Start", "macro", 500, 250)
    drag(page, "Poses", "pose", 520, 300)
    type_into(page, "1", "0.2")
    type_into(page, "0", "40")
    expect(page.get_by_text("1 action", exact=True)).to_be_visible()
    write(page)
    until(lambda: wire.count(_ADD_MACRO) == 1)
    assert wire.count(_ADD_ACTION) == 1
    until(lambda: [macro.macro_caption for macro in board.macros()] == ["Macro"])
    assert board.action(1).steps == (Step(1, 40, 20),)
    board.run_macro(1, wait=True)
    assert board.servo(1).angle == 40
    go(page, "Blocks")
    expect(page.get_by_text("The draft has what these blocks make.")).to_be_visible()
    assert page.get_by_role("button", name="Make actions and macros").is_disabled()


def test_blocks_put_together_with_the_keyboard_start_from_a_button(place: Place) -> None:
    page, wire, board = place
    page.locator(".blocklyToolboxCategoryContainer").first.focus()
    keys = "t ArrowRight ArrowDown Enter Enter "  # the button block
    keys += "t ArrowDown ArrowDown ArrowRight ArrowDown ArrowDown ArrowDown Enter Enter "  # repeat, put into it
    keys += "t ArrowRight ArrowDown ArrowDown Enter Enter "  # wait, put into that
    for key in keys.split():
        page.keyboard.press(key)
    expect(page.get_by_text("1 button")).to_be_visible()
    expect(page.get_by_text("The board cannot run")).to_have_count(0)
    write(page)
    until(lambda: wire.count(_ADD_TABLE) == 1)
    [table] = board.export_project().joystick_tables
    [macro] = board.export_project().macros
    assert macro.commands == (MacroCommand(1000, 1, loop=2, total_interval=2000),)
    assert (table.buttons[0].button_id, table.buttons[0].button_press_macro) == (1, macro.macro_id)


def test_a_block_that_no_board_can_run_says_why_and_is_undone(studio: Studio, browser: Any) -> None:
    with blocks(browser, studio.url) as page:
        drag(page, "Start", "macro", 500, 250)
        drag(page, "Not on a board", "if", 520, 300)
        refused = page.get_by_role("button", name="A board cannot decide while a macro runs")
        expect(refused).to_be_visible()
        assert page.get_by_role("button", name="Make actions and macros").is_disabled()
        refused.click()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        expect(page.locator(".blocklyTextBubble")).to_contain_text("A board cannot decide")
        page.get_by_role("button", name="Undo a change of the blocks").click()
        expect(refused).to_have_count(0)


def test_blocks_open_again_as_they_were_and_reach_files(studio: Studio, browser: Any, tmp_path: Path) -> None:
    with blocks(browser, studio.url) as page:
        drag(page, "Start", "macro", 500, 250)
        type_into(page, "Macro", "<b>Bow</b>")
        drag(page, "Commands", "wait", 520, 300)
        expect(page.get_by_text("1 macro")).to_be_visible()
        expect(page.get_by_text("The board cannot run")).to_have_count(0)
        go(page, "Live")
        page.reload()
        go(page, "Blocks")
        expect(page.locator(".blocklyDraggable").locator("visible=true")).to_have_count(2)
        expect(page.locator(".blocklyField", has_text="<b>Bow</b>").locator("visible=true")).to_be_visible()
        go(page, "Project")
        with page.expect_download() as download:
            page.get_by_role("button", name="Save a file").click()
        download.value.save_as(tmp_path / "out.json")
    saved = json.loads((tmp_path / "out.json").read_text())["blocks"]
    [stack] = saved["stacks"]
    assert [(one["type"], one["caption"]) for one in stack["blocks"]] == [("macro", "<b>Bow</b>")]
    assert stack["blocks"][0]["blocks"][0]["delay_ms"] == 1000


@needs_npm
@pytest.mark.parametrize("size", ["desktop", "phone", "zoomed"])
def test_the_screen_is_accessible_and_fits(studio: Studio, browser: Any, axe: str, size: str) -> None:
    with blocks(browser, studio.url, size) as page:
        drag(page, "Not on a board", "repeat", 330, 300)
        page.evaluate(axe)
        assert found_by_axe(page) == []
        page.locator(".blocklyToolboxCategory").nth(1).click()
        page.locator(".blocklyToolboxFlyout [role=option], .blocklyFlyout [role=option]").first.wait_for()
        assert found_by_axe(page) == []
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
