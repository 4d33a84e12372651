"""The studio without a server of its own: `.ci/page` builds a folder that any web server serves, and Chromium runs it.

Module: servolink.studio.worker_door.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from tests.studio.browser import in_browser

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = [*in_browser, pytest.mark.skipif(shutil.which("npm") is None, reason="npm is not installed")]

START = 240_000  # milliseconds for Python to start in the page, on the slowest machine
MOST = 10_000_000
"""Bytes of a first visit, as gzip."""


class Quiet(SimpleHTTPRequestHandler):
    """Files of a folder, without a log."""

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name of the library
        """Log nothing."""


@pytest.fixture
def url(built: tuple[Path, str]) -> Iterator[str]:
    """The address of the page at a server of plain files, in a folder of the site."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=built[0].parent))
    thread = Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}/page/"
    server.shutdown()
    thread.join()
    server.server_close()


def test_the_page_is_small(built: tuple[Path, str]) -> None:
    said = re.search(r"([0-9,]+) bytes as gzip", built[1])
    assert said is not None
    assert int(said[1].replace(",", "")) <= MOST


def test_a_virtual_robot_stands_in_the_page_and_moves(url: str, browser: Any) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    foreign: list[str] = []
    page.on("request", lambda request: None if request.url.startswith(url) else foreign.append(request.url))
    page.goto(url)
    expect(page.get_by_text("VIRTUAL BOARD")).to_be_visible(timeout=START)
    expect(page.locator(".sv [data-part=angle]").first).to_be_visible(timeout=START)
    page.get_by_role("button", name="Robot", exact=True).click()
    before = page.locator(".sv [data-part=angle]").first.inner_text()
    slider = page.get_by_label("Target of servo 1,")
    for _ in range(10):
        slider.press("ArrowRight", delay=300)
    expect(page.locator(".sv [data-part=angle]").first).not_to_have_text(before, timeout=START)
    assert (errors, foreign) == ([], [])
