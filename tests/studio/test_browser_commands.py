"""Every command of the document from the page: what a person does with the mouse reaches the board as frames.

Frames are read from the line between studio and board, and the commands from the table in `tests/data/vectors.json`.
The board is behind a studio's server, or at a port of the browser that has the whole studio, on a bad line too.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from servolink import sync
from servolink.boards import running_hubs
from servolink.project import load_project
from tests.processes import until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import DEMO, in_browser, opened, running, show
from tests.studio.page_server import PATIENT, SERIAL, PageServer
from tests.studio.test_browser_ports import START, connect
from tests.studio.wire import Wire, wire_to

pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")

pytestmark = in_browser

_VECTORS = json.loads((Path(__file__).parents[1] / "data/vectors.json").read_text())
COMMANDS = {
    int(vector["id"]): str(vector["name"])
    for vector in _VECTORS
    if vector["id"] % 10 == 0 or vector["id"] == 40081  # requests, and the only frame that no request asks for
}
_ALL = 0xFF


class Place(NamedTuple):
    """A page of a studio, and the line behind the studio."""

    page: Any
    wire: Wire
    board: sync.Board
    is_at_port: bool

    def button(self, name: str) -> Any:
        """Return the button of this name."""
        return self.page.get_by_role("button", name=name, exact=True)


DOORS = [
    "server",
    *(
        pytest.param(door, marks=[pytest.mark.slow, pytest.mark.skipif(shutil.which("npm") is None, reason="no npm")])
        for door in ("port", "port on a bad line")
    ),
]
"""Ways from the page to the board: a studio's server, or a serial port of the browser."""
_BAD_LINE = "drop=0.0001,flip=0.0001"  # of all bytes: one response of many servos in ten


@pytest.fixture(scope="module", params=DOORS)
def place(request: pytest.FixtureRequest, chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    """A studio on a board with the demo content. The folders of the user are those of this module alone."""
    folder = tmp_path_factory.mktemp("commands")
    runtime = folder / "runtime"
    runtime.mkdir(mode=0o700)
    with ExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setenv("XDG_RUNTIME_DIR", str(runtime))
        patch.setenv("XDG_DATA_HOME", str(folder / "data"))
        patch.setenv("XDG_CONFIG_HOME", str(folder / "config"))
        faults = ("--faults", _BAD_LINE) if "bad line" in request.param else ()
        program = BoardProgram(folder, "--servos", "16", *faults)
        stack.callback(program.kill)
        wire = stack.enter_context(wire_to(program.url))
        if request.param == "server":
            url = stack.enter_context(running("studio", "--board", wire.url))
            [hub] = running_hubs()
            board = stack.enter_context(sync.connect(hub.url))
            board.apply_project(load_project(DEMO), backup=False)
            page = stack.enter_context(opened(chromium, url))
        else:
            board = stack.enter_context(sync.connect(program.url))
            board.apply_project(load_project(DEMO), backup=False)
            built, _ = request.getfixturevalue("built")
            page = stack.enter_context(_at_port(chromium, built, wire.url))
        yield Place(page, wire, board, request.param != "server")


@contextmanager
def _at_port(chromium: Any, built: Path, board_url: str) -> Iterator[Any]:
    """Yield a page without a server that is connected to the board at its port."""
    server = PageServer(built, board_url)
    context = chromium.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    page.add_init_script(SERIAL)
    page.add_init_script(PATIENT)
    page.goto(f"{server.url}#board")
    try:
        connect(page)
        yield page
    finally:
        context.close()
        server.close()


def read_again(place: Place) -> None:
    show(place.page, "Project")
    place.button("Read again").click()


def reload(place: Place) -> None:
    place.page.reload()
    if place.is_at_port:
        place.page.get_by_text("webserial://1a86:7523").first.wait_for(timeout=START)
    show(place.page, "Live")


def read_settings(place: Place) -> None:
    show(place.page, "Board")
    place.page.get_by_role("region", name="Settings and memory").get_by_role("button", name="Read", exact=True).click()


def write(place: Place) -> None:
    """Write the edits to the board."""
    show(place.page, "Project")
    place.button("Write to the board").click()
    place.page.get_by_text("Written", exact=True).wait_for()


def set_mode(place: Place) -> None:
    show(place.page, "Board")
    place.button("Set mode 1").click()


def clear(place: Place) -> None:
    """Delete everything, and bring it back."""
    before = place.board.export_project()
    show(place.page, "Board")
    place.button("Delete everything …").click()
    dialog = place.page.get_by_role("dialog")
    assert dialog.get_by_role("button", name="Delete everything").is_disabled()
    dialog.get_by_role("checkbox").check()
    dialog.get_by_role("button", name="Delete everything").click()
    place.page.get_by_text("Written", exact=True).wait_for()
    assert place.board.actions() == ()
    kept = re.search(r"kept as (backup \d+)", place.page.get_by_text("kept as backup").inner_text())
    assert kept is not None
    backup = place.page.get_by_role("listitem").filter(has=place.page.get_by_text(kept[1], exact=True))
    backup.get_by_role("button", name="Roll back …").click()
    dialog.get_by_role("button", name="Roll back").click()
    place.page.get_by_text("Rolled back", exact=True).wait_for()
    assert place.board.export_project().actions == before.actions


def run_line_test(place: Place) -> None:
    show(place.page, "Board")
    place.button("Test").click()
    place.page.get_by_role("img", name=re.compile("40 of 40 answered")).wait_for()


def watch(place: Place) -> None:
    show(place.page, "Live")


def stop_one(place: Place) -> None:
    show(place.page, "Live")
    place.page.get_by_role("button", name=re.compile("^(L|Left) elbow$")).click()  # renamed by another row
    place.button("Hold here").click()
    until(lambda: place.wire.sent_of(20030)[-1:] == [bytes((6, 0, 1))])
    place.button("Start").click()


def raw_angles(place: Place) -> None:
    show(place.page, "Board")
    card = place.page.get_by_role("region", name="Raw angles")
    card.get_by_role("button", name="Read").click()
    card.get_by_role("row").nth(16).wait_for()
    assert bytes((_ALL, 1)) in place.wire.sent_of(20040)
    card.get_by_role("button", name="End").click()


def move(place: Place) -> None:
    show(place.page, "Live")
    place.page.get_by_role("group", name="Robot").get_by_role("button", name="Robot").click()
    slider = place.page.get_by_label("Target of servo 6")
    before = place.wire.count(20050)

    def press() -> bool:
        slider.press("ArrowRight", delay=300)  # again and again: a busy page may lose the lease meanwhile
        return place.wire.count(20050) > before

    until(press)
    place.page.get_by_role("group", name="Robot").get_by_role("button", name="Preview").click()


def held(place: Place, packet_id: int) -> None:
    """Let the board run what is shown, for as long as it takes to see the frame."""
    place.button("As stored").click()
    before = place.wire.count(packet_id)
    button = place.button("Hold: the board runs it")
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    place.page.mouse.move(box["x"] + 20, box["y"] + 20)
    place.page.mouse.down()
    until(lambda: place.wire.count(packet_id) > before)
    stops = place.wire.count(20030)
    place.page.mouse.up()
    until(lambda: place.wire.count(20030) > stops)  # released before the end


def run_action(place: Place) -> None:
    show(place.page, "Actions")
    place.page.locator(".pose").filter(has_text="Stand").first.click()
    held(place, 20060)


def run_macro(place: Place) -> None:
    show(place.page, "Macros")
    place.page.locator(".mrow").filter(has_text="Dance").first.click()
    held(place, 30090)


def add_action(place: Place) -> None:
    show(place.page, "Actions")
    place.button("New action, as the robot stands now").click()
    write(place)


def delete_action(place: Place) -> None:
    add_action(place)
    show(place.page, "Actions")
    place.page.get_by_role("button", name="More: duplicate, delete").first.click()
    place.page.get_by_role("menuitem", name="Delete").click()
    write(place)


def add_macro(place: Place) -> None:
    show(place.page, "Macros")
    place.button("New macro").click()
    place.button("Add a pause").click()
    write(place)


def delete_macro(place: Place) -> None:
    add_macro(place)
    show(place.page, "Macros")
    place.page.locator(".mrow[aria-pressed=true]").click()
    place.page.get_by_role("button", name="More: duplicate, delete").click()
    place.page.get_by_role("menuitem", name="Delete").click()
    write(place)


def name_and_trim(place: Place) -> None:
    show(place.page, "Servos")
    place.page.locator(".mrow").nth(5).click()
    place.page.get_by_label("Name of the servo").fill("Left elbow")
    place.page.get_by_label("Name of the servo").press("Enter")
    start = place.button("Start all servos")  # stopped by another row
    if start.is_visible():
        start.click()
        start.wait_for(state="hidden")
    was, old = place.board.servo(6).angle, place.board.servo_parameters()[5].adjusted_degree
    place.button("+5°").click()
    until(lambda: place.board.servo(6).angle == was + 5)
    shown = f"{was + 5}°".replace("-", "\u2212")
    place.page.locator("[data-servo='6']").filter(has_text=re.compile(f"^{shown}$")).wait_for()
    place.button("It stands right").click()
    write(place)
    after = place.board.servo_parameters()[5]
    assert (after.servo_caption, after.adjusted_degree) == ("Left elbow", old + 5)


def write_project_id(place: Place) -> None:
    show(place.page, "Board")
    change = place.button("Change the number of the project …")
    field = place.page.get_by_label("New number of the project, 0 for none")
    change.or_(field).first.wait_for()
    if change.is_visible():
        change.click()
    field.fill("4321")
    field.press("Enter")
    write(place)
    assert (4321).to_bytes(4, "little") in place.wire.sent_of(30120)


def add_table(place: Place) -> None:
    show(place.page, "Buttons")
    place.button("New table").click()
    place.page.get_by_role("dialog").get_by_role("button", name="Keep").click()
    write(place)


def choose_for_table(place: Place, verb: str) -> None:
    """Add a table and choose from its menu."""
    add_table(place)
    show(place.page, "Buttons")
    place.page.get_by_role("button", name=re.compile("^More for")).click()
    place.page.get_by_role("menuitem", name=re.compile(f"^{verb} ")).click()
    write(place)


def use_table(place: Place) -> None:
    choose_for_table(place, "Use")


def delete_table(place: Place) -> None:
    choose_for_table(place, "Delete")


def hear_button(place: Place) -> None:
    show(place.page, "Buttons")
    events = place.page.get_by_role("log").get_by_role("listitem")
    place.wire.push(40081, (9).to_bytes(4, "little") + b"\0")
    events.filter(has_text="9").first.wait_for()


GESTURES: dict[int, Callable[[Place], None]] = {
    10010: set_mode,
    10020: clear,
    10030: read_settings,
    10040: reload,
    10050: run_line_test,
    20010: read_settings,
    20020: watch,
    20030: stop_one,
    20040: raw_angles,
    20050: move,
    20060: run_action,
    30010: read_again,
    30020: read_again,
    30030: add_action,
    30040: delete_action,
    30050: read_again,
    30060: read_again,
    30070: add_macro,
    30080: delete_macro,
    30090: run_macro,
    30100: read_again,
    30110: name_and_trim,
    30120: write_project_id,
    30130: read_settings,
    40010: read_again,
    40020: read_again,
    40030: add_table,
    40040: delete_table,
    40050: use_table,
    40060: read_again,
    40070: reload,
    40081: hear_button,
}
"""A way of a person to each command."""


@pytest.mark.parametrize("packet_id", GESTURES, ids=lambda packet_id: f"{packet_id}-{COMMANDS[packet_id]}")
def test_each_command_of_the_document_is_reached_from_the_page(place: Place, packet_id: int) -> None:
    before = place.wire.count(packet_id)
    GESTURES[packet_id](place)
    if packet_id % 10 == 0:
        until(lambda: place.wire.count(packet_id) > before)


def test_every_command_of_the_document_is_in_the_table() -> None:
    assert set(COMMANDS) == set(GESTURES)
    assert len(COMMANDS) == 32
