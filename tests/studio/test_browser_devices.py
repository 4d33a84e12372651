"""Robots at devices of the browser: boards behind USB and HID, and a tab that is closed in an import."""

from __future__ import annotations

import json
import re
import shutil
import time
from pathlib import Path
from typing import Any

import pytest

from servolink.protocol import Query
from tests.processes import until
from tests.studio.board_program import BoardProgram
from tests.studio.browser import DEMO, in_browser
from tests.studio.page_server import PATIENT, PageServer
from tests.studio.test_browser_ports import START, connect, opened, wait_for_stop

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = [*in_browser, pytest.mark.slow, pytest.mark.timeout(900)]
pytestmark += [pytest.mark.skipif(shutil.which("npm") is None, reason="npm is needed")]

DEVICES = Path(__file__).with_name("device_stand_ins.js").read_text(encoding="utf-8")
CALL = """async ([method, params]) => {
    const { WorkerLine } = await import(new URL("link/worker-line.js", location.href));
    const line = new WorkerLine();
    return new Promise(done => {
        line.onopen = () => line.send(JSON.stringify({ token: "" }));
        line.onmessage = ({ data }) => {
            const message = JSON.parse(data);
            if (message.session) line.send(JSON.stringify({ jsonrpc: "2.0", id: "own", method, params }));
            else if (message.id === "own") done(message.error ?? message.result);
        };
    });
}"""
"""Calls a method of the hub in the page."""


@pytest.mark.parametrize(("kind", "scheme"), [("USB", "webusb"), ("HID", "webhid")])
def test_a_robot_behind_a_device_moves_stops_and_is_unplugged(
    kind: str, scheme: str, built: tuple[Path, str], browser: Any, tmp_path: Path
) -> None:
    board = BoardProgram(tmp_path)
    server = PageServer(built[0], board.url)
    try:
        page = browser.new_context(locale="en-GB").new_page()
        page.add_init_script(DEVICES)
        page.add_init_script(PATIENT)
        page.goto(f"{server.url}#board")
        expect(page.get_by_text("VIRTUAL BOARD")).to_be_visible(timeout=START)
        page.get_by_role("button", name=re.compile(f"A board without a serial port: {kind}")).click(timeout=START)
        expect(page.get_by_text(f"{scheme}://1209:0001").first).to_be_visible(timeout=START)
        expect(page.get_by_text("VIRTUAL BOARD")).to_have_count(0)
        page.get_by_role("link", name="Live").click()
        page.get_by_role("button", name="Robot", exact=True).click()
        angle = page.locator(".sv [data-part=angle]").first
        before = angle.inner_text(timeout=START)
        for _ in range(10):
            page.get_by_label("Target of servo 1,").press("ArrowRight", delay=300)
        expect(angle).not_to_have_text(before, timeout=START)
        pressed = time.time()
        page.locator("button.stop").first.click()
        wait_for_stop(server, pressed)
        expect(page.get_by_text("The robot is stopped.")).to_be_visible(timeout=START)
        server.unplug()
        expect(page.get_by_text("The board is gone.")).to_be_visible(timeout=START)
    finally:
        server.close()
        board.kill()


@pytest.mark.parametrize("writes", [1, 4, 9])
def test_after_a_tab_is_closed_in_an_import_the_next_visit_goes_on(
    writes: int, built: tuple[Path, str], browser: Any, tmp_path: Path
) -> None:
    board = BoardProgram(tmp_path, "--write-seconds", "0.05")
    server = PageServer(built[0], board.url)
    ask = ["project.apply", {"project": json.loads(DEMO.read_text(encoding="utf-8"))}]
    try:
        context = browser.new_context(locale="en-GB")
        page = opened(context, server.url)
        connect(page)
        begun = time.time()
        page.evaluate(f"(ask) => void ({CALL})(ask)", ask)
        until(lambda: sum(not isinstance(each, Query) for each in server.packets(begun)) >= writes)
        page.close()
        page = opened(context, server.url)
        connect(page)
        assert page.evaluate(CALL, ["project.plan", ask[1]])["is_unfinished"]
        assert page.evaluate(CALL, ask)["resumed"]
        assert page.evaluate(CALL, ["project.plan", ask[1]])["changes"] == []
    finally:
        server.close()
        board.kill()
