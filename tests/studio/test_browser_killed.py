"""The board and the studio's server are killed in the middle of things: nothing is lost, and it goes on."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import servolink
from servolink import Action, Macro, build_project, sync
from tests.processes import finish, start
from tests.studio.board_program import BoardProgram
from tests.studio.browser import DEMO, in_browser, new_profile, opened

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = in_browser


@pytest.fixture
def board(user: Path) -> Iterator[BoardProgram]:
    program = BoardProgram(user, "--write-seconds", "0.1")
    yield program
    program.kill()


def started(board: BoardProgram) -> tuple[subprocess.Popen[str], str]:
    """Start a studio of the board; return its process and address."""
    program = start([sys.executable, "-m", "servolink", "studio", "--board", board.url, "--no-browser"])
    assert program.stdout is not None
    return program, program.stdout.readline().split()[-1]


def begin_to_write(page: Any) -> None:
    """Open the demo and begin to write it to the board."""
    page.get_by_role("link", name="Project").click()
    page.get_by_label("Open a file").set_input_files(str(DEMO))
    page.get_by_role("button", name="Write to the board").click()


def at(page: Any, item: str) -> None:
    """Wait until an item is being written."""
    page.locator("p[role=status]").filter(has_text=item).wait_for()


def go_on(page: Any) -> None:
    page.get_by_role("button", name="Go on").click()
    expect(page.get_by_text("Written", exact=True)).to_be_visible()


def content_of(board: BoardProgram) -> Any:
    with sync.connect(board.url) as connected:
        return connected.export_project()


@pytest.mark.parametrize(("item", "seconds"), [("project id", "2"), ("action", "0.2")], ids=["marking", "writing"])
def test_a_board_that_loses_power_in_the_middle_of_a_write_goes_on(
    board: BoardProgram, browser: Any, item: str, seconds: str
) -> None:
    board.kill()
    board.start("--write-seconds", seconds)  # so that a busy page still shows the item while it is being written
    program, url = started(board)
    with opened(browser, url) as page:
        begin_to_write(page)
        at(page, item)
        board.kill()
        expect(page.get_by_text("The board is gone")).to_be_visible()
        board.start("--write-seconds", "0")
        go_on(page)
    finish(program, signal.SIGTERM)
    assert content_of(board) == servolink.load_project(DEMO)


def test_a_studio_that_is_killed_while_it_writes_goes_on(board: BoardProgram, browser: Any) -> None:
    program, url = started(board)
    with opened(browser, url, loss=True) as page:
        begin_to_write(page)
        at(page, "action")
        finish(program, signal.SIGKILL)
        expect(page.get_by_text("The studio does not answer.")).to_be_visible()
    program, url = started(board)
    with opened(browser, url) as page:
        page.get_by_role("link", name="Project").click()
        go_on(page)
    finish(program, signal.SIGTERM)
    assert content_of(board) == servolink.load_project(DEMO)


def test_an_edit_that_a_killed_studio_did_not_keep_is_there_in_the_next_one(board: BoardProgram, browser: Any) -> None:
    with sync.connect(board.url) as connected:
        connected.apply_project(servolink.load_project(DEMO), backup=False)
    program, url = started(board)
    profile = new_profile(browser)
    with opened(browser, url, profile=profile, loss=True) as page:
        page.get_by_role("link", name="Actions").click()
        for name, is_there in (("kept", True), ("here", False)):
            page.get_by_label("Name", exact=True).fill(name)
            page.get_by_label("Name", exact=True).press("Enter")
            expect(
                page.get_by_text(re.compile("not written saved" if is_there else "kept in this browser"))
            ).to_be_visible()
            if is_there:
                finish(program, signal.SIGKILL)
                expect(page.get_by_text("The studio does not answer.")).to_be_visible()
    program, again = started(board)
    assert again.partition("#")[0] == url.partition("#")[0]
    with opened(browser, again, profile=profile) as page:
        page.get_by_role("link", name="Actions").click()
        expect(page.get_by_label("Name", exact=True)).to_have_value("here")
    finish(program, signal.SIGTERM)


def shared_with(board: BoardProgram, caption: str) -> subprocess.Popen[str]:
    """Store a macro and an action of this name on a board, and share it as `rex`."""
    macro = Macro.of(caption, Action.pose(f"{caption} pose", {1: 30}, seconds=0.5))
    with sync.connect(board.url) as connected:
        connected.apply_project(build_project(macro), backup=False)
    program = start([sys.executable, "-m", "servolink", "share", "--board", board.url, "--name", "rex"])
    assert program.stdout is not None
    assert "share://rex" in program.stdout.readline(), finish(program)
    return program


def test_a_page_shows_what_the_board_holds_that_has_the_name_now_and_keeps_its_edits(
    board: BoardProgram, tmp_path: Path, browser: Any
) -> None:
    (tmp_path / "other").mkdir()
    other = BoardProgram(tmp_path / "other")
    hub = shared_with(board, "Alpha")
    studio = start([sys.executable, "-m", "servolink", "studio", "--board", "rex", "--no-browser"])
    assert studio.stdout is not None
    with opened(browser, studio.stdout.readline().split()[-1], loss=True) as page:
        page.get_by_role("link", name="Actions").click()
        expect(page.get_by_label("Name", exact=True)).to_have_value("Alpha pose")
        page.get_by_label("Name", exact=True).fill("mine")
        page.get_by_label("Name", exact=True).press("Enter")
        expect(page.get_by_text(re.compile("not written saved"))).to_be_visible()
        page.get_by_role("link", name="Macros").click()
        page.locator(".mrow").get_by_text("Alpha").wait_for()
        finish(hub, signal.SIGKILL)
        expect(page.get_by_text("The board is not shared any more.")).to_be_visible()
        hub = shared_with(other, "Beta")
        page.locator(".mrow").get_by_text("Beta").wait_for()
        expect(page.locator(".mrow").get_by_text("Alpha")).to_have_count(0)
        page.get_by_role("link", name="Actions").click()
        expect(page.get_by_label("Name", exact=True)).to_have_value("mine")
    for program in (studio, hub):
        finish(program, signal.SIGTERM)
    other.kill()


def test_a_page_says_that_the_program_is_gone_that_shared_its_board(board: BoardProgram, browser: Any) -> None:
    first, _ = started(board)
    second = start([sys.executable, "-m", "servolink", "studio", "--no-browser"])
    assert second.stdout is not None
    with opened(browser, second.stdout.readline().split()[-1], loss=True) as page:
        page.locator(".sv [data-part=angle]").first.wait_for()
        finish(first, signal.SIGKILL)
        expect(page.get_by_text("The board is not shared any more.")).to_be_visible()
        first, _ = started(board)
        expect(page.get_by_text("The board is not shared any more.")).to_be_hidden()
        expect(page.get_by_text("in this computer")).to_be_visible()
    for program in (second, first):
        finish(program, signal.SIGTERM)
