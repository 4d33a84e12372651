"""The studio without a server of its own: `.ci/page` builds a folder that any web server serves, and Chromium runs it.

Module: servolink.studio.worker_door.
"""

from __future__ import annotations

import json
import re
import shutil
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from hashlib import sha256
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from tests.studio.browser import CHROMIUM, OF_OTHERS, OPTIONS, in_browser

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
expect = playwright.expect

pytestmark = [*in_browser, pytest.mark.skipif(shutil.which("npm") is None, reason="npm is not installed")]

ROOT = Path(__file__).parents[2]
START = 240_000  # milliseconds for Python to start in the page, on the slowest machine
MOST = 10_000_000
"""Bytes of a first visit, as gzip."""


class Quiet(SimpleHTTPRequestHandler):
    """Files of a folder, without a log."""

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name of the library
        """Log nothing."""


@contextmanager
def served(folder: Path, port: int = 0) -> Iterator[int]:
    """Serve the folders beside a built page as plain files; yield the port."""
    server = ThreadingHTTPServer(("127.0.0.1", port), partial(Quiet, directory=folder.parent))
    thread = Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def url(built: tuple[Path, str]) -> Iterator[str]:
    """The address of the page at a server of plain files, in a folder of the site."""
    with served(built[0]) as port:
        yield f"http://127.0.0.1:{port}/page/"


def move(page: Any) -> None:
    """Move a servo of the virtual robot, and wait until it is elsewhere."""
    expect(page.get_by_text("VIRTUAL BOARD")).to_be_visible(timeout=START)
    angle = page.locator(".sv [data-part=angle]").first
    expect(angle).to_be_visible(timeout=START)
    if (start := page.get_by_role("button", name="Robot", exact=True)).is_visible():
        start.click()
    before = angle.inner_text()
    slider = page.get_by_label("Target of servo 1,")
    for _ in range(10):
        slider.press("ArrowRight", delay=300)
    expect(angle).not_to_have_text(before, timeout=START)


def visit(page: Any, url: str) -> None:
    """Open the page, and wait until the browser keeps it."""
    page.goto(url)
    expect(page.get_by_text("The studio now works without a network too.")).to_be_visible(timeout=START)


@contextmanager
def person(browser: Any, folder: Path) -> Iterator[Any]:
    """Another browser of this kind, of a person whose files outlast it in a folder."""
    context = browser.browser_type.launch_persistent_context(folder, executable_path=CHROMIUM, args=OPTIONS)
    yield context
    context.close()


def test_the_page_is_small(built: tuple[Path, str]) -> None:
    said = re.search(r"([0-9,]+) bytes as gzip", built[1])
    assert said is not None
    assert int(said[1].replace(",", "")) <= MOST


def test_a_virtual_robot_stands_in_the_page_and_moves(url: str, browser: Any) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    foreign: list[str] = []
    page.on("request", lambda request: None if request.url.startswith(url) else foreign.append(request.url))
    page.goto(url)
    move(page)
    assert (errors, foreign) == ([], [])


def test_after_one_visit_the_page_needs_no_server_and_outlasts_the_browser(
    built: tuple[Path, str], browser: Any, tmp_path: Path
) -> None:
    with served(built[0]) as port, person(browser, tmp_path / "person") as own:
        page = own.new_page()
        visit(page, f"http://127.0.0.1:{port}/page/")
        problems = own.new_cdp_session(page).send("Page.getInstallabilityErrors")["installabilityErrors"]
        assert problems == []
    with person(browser, tmp_path / "person") as own:
        page = own.new_page()
        foreign: list[str] = []
        page.on("requestfailed", lambda request: foreign.append(request.url))
        page.goto(f"http://127.0.0.1:{port}/page/")
        move(page)
        assert foreign == []


@pytest.mark.slow
def test_drafts_outlast_the_tab_and_the_browser(url: str, browser: Any, tmp_path: Path) -> None:
    def edited(page: Any) -> Any:
        page.goto(f"{url}#actions")
        page.locator(".pose").filter(has_text="Arm up").click(timeout=START)
        return page.get_by_label("Time of R arm")

    with person(browser, tmp_path / "person") as own:
        page = own.new_page()
        field = edited(page)
        field.fill("0,9 s")
        field.press("Enter")
        expect(page.get_by_text(re.compile("not written saved"))).to_be_visible()
        page.close()  # its worker is ended, and told nothing
        expect(edited(own.new_page())).to_have_value("0.90 s", timeout=START)
    with person(browser, tmp_path / "person") as own:
        expect(edited(own.new_page())).to_have_value("0.90 s", timeout=START)


@pytest.mark.slow
def test_a_newer_version_is_offered_and_kept(built: tuple[Path, str], browser: Any, tmp_path: Path) -> None:
    folder = shutil.copytree(built[0], tmp_path / "page")
    with served(folder) as port:
        own = browser.new_context()
        page = own.new_page()
        visit(page, f"http://127.0.0.1:{port}/page/")
        change(folder)
        page.reload()
        offer = page.get_by_role("button", name="Load it")
        expect(offer).to_be_visible(timeout=START)
        assert page.title() == "servolink studio"
        other = own.new_page()
        other.goto(f"http://127.0.0.1:{port}/page/")
        offer.click()
        expect(page.get_by_text("The studio is open in other windows: close them first.")).to_be_visible(timeout=START)
        other.close()
        with page.expect_navigation(timeout=START):
            offer.click()
    page.reload()  # the server has ended
    expect(page).to_have_title("newer studio")
    move(page)
    keys = page.evaluate("async () => (await (await caches.open((await caches.keys())[0])).keys()).length")
    assert keys == len(build_of(folder)["files"])


def build_of(folder: Path) -> Any:
    """Return what the service worker of a page knows about the page."""
    return json.JSONDecoder().raw_decode((folder / "service-worker.js").read_text().removeprefix("self.BUILD = "))[0]


def change(folder: Path) -> None:
    """Make a newer version of a page: another title."""
    index, worker = folder / "index.html", folder / "service-worker.js"
    old = build_of(folder)["files"]["index.html"]
    index.write_text(index.read_text().replace("servolink studio", "newer studio"))
    new = b64encode(sha256(index.read_bytes()).digest()).decode()
    worker.write_text(worker.read_text().replace(old, new))


def test_the_service_worker_knows_exactly_the_files_of_the_folder(built: tuple[Path, str]) -> None:
    folder = built[0]
    found = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    del found["service-worker.js"], found["_headers"]
    assert build_of(folder)["files"] == {
        name: b64encode(sha256(path.read_bytes()).digest()).decode() for name, path in found.items()
    }


@pytest.mark.slow
def test_kept_files_come_with_the_policy(built: tuple[Path, str], url: str, browser: Any) -> None:
    page = browser.new_page()
    visit(page, url)
    answer = page.reload()
    assert answer.from_service_worker
    sent = build_of(built[0])["headers"]
    assert answer.all_headers() | {name.lower(): value for name, value in sent.items()} == answer.all_headers()
    rules = sent["Content-Security-Policy"].split("; ")
    sources = {source for rule in rules for source in rule.split()[1:]}
    assert sources <= {"'self'", "'none'", "'wasm-unsafe-eval'", "data:", "blob:"}
    lines = (built[0] / "_headers").read_text().splitlines()
    assert lines == ["/*", *(f"  {name}: {value}" for name, value in sent.items())]
    nginx = [f'    add_header {name} "{value}";' for name, value in sent.items()]
    assert "\n".join(nginx) in (ROOT / "docs/how-to/without-installation.md").read_text()
    blocked = page.evaluate("fetch('http://evil.example/').then(() => 'let out', () => 'blocked')")
    assert blocked == "blocked"
    move(page)  # the worker too is under the policy now


def test_nothing_moves_in_a_frame_of_another_site(built: tuple[Path, str], url: str, browser: Any) -> None:
    (built[0].parent / "frame.html").write_text(f'<iframe src="{url}"></iframe>')
    page = browser.new_page()
    page.goto(url.replace("127.0.0.1", OF_OTHERS).replace("page/", "frame.html"))
    inside = page.frame_locator("iframe")
    expect(inside.get_by_role("link", name="The studio does not run inside another page.")).to_be_visible()
    assert (inside.get_by_role("button").count(), page.workers) == (0, [])


@pytest.mark.slow
def test_an_address_without_https_is_said_in_a_sentence(url: str, browser: Any) -> None:
    page = browser.new_page()
    page.goto(url.replace("127.0.0.1", OF_OTHERS))
    expect(page.get_by_text("At this address only the virtual robot works")).to_be_visible(timeout=START)
    move(page)
