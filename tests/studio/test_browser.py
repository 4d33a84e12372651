"""The studio in a real browser, checked on the board: `pytest -m browser`."""

from __future__ import annotations

import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink import sync
from tests.processes import until
from tests.studio.browser import LISTEN, OF_OTHERS, SIZES, Studio, grab, in_browser, is_stopped, opened, running

playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")

pytestmark = in_browser


@pytest.mark.parametrize("size", SIZES)
def test_the_page_shows_every_servo_and_the_banner(studio: Studio, browser: Any, size: str) -> None:
    with opened(browser, studio.url, size) as page:
        page.get_by_text("VIRTUAL BOARD").wait_for()
        playwright.expect(page.locator(".sv")).to_have_count(16)
        playwright.expect(page.locator("[data-part=angle]").first).to_contain_text("°")
        stop = page.get_by_role("button", name="STOP Esc").locator("visible=true")
        playwright.expect(stop).to_be_in_viewport(ratio=1)
        assert "token" not in page.url
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_robot_moves_while_a_slider_is_held_and_not_longer(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        page.locator(".stage .seg").get_by_text("Robot").click()
        before = studio.angle(2)
        x, y = grab(page, 2)
        for step in range(60):
            page.mouse.move(x + step, y)
        until(lambda: studio.angle(2) > before + 20)
        page.mouse.up()
        playwright.expect(page.get_by_text("You have control")).to_be_visible()
        until(lambda: all(servo.is_start for servo in studio.board.servos()))


def test_a_robot_that_answers_late_stops_where_it_is_and_never_turns_back(user: Path, browser: Any) -> None:
    board = "virtual://?servos=16&turnaround=0.1"
    with running("--board", board, "studio") as url, sync.connect("share://virtual") as reader:
        studio = Studio(url, reader)
        with opened(browser, url) as page:
            page.evaluate(LISTEN)
            before = studio.angle(2)
            x, y = grab(page, 2)
            page.mouse.move(x + 100, y, steps=10)
            page.mouse.up()
            goal = int(page.get_by_label("Target of servo 2,").input_value())
            page.get_by_role("button", name="Hold to move").hover()
            page.mouse.down()
            until(lambda: studio.angle(2) > before + 10)
            page.mouse.up()
            angles = [studio.angle(2)]
            while len(angles) < 3 or len(set(angles[-3:])) > 1:
                angles.append(studio.angle(2))
            assert angles == sorted(angles)
            assert angles[-1] < goal - 10
            assert "move.end" in page.evaluate("window.sent")
            until(lambda: all(servo.is_start for servo in reader.servos()))


def test_who_takes_over_watches_over_the_robot(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page, opened(browser, studio.url, "phone") as other:
        page.locator(".stage .seg").get_by_text("Robot").click()
        before = studio.angle(2)
        x, y = grab(page, 2)
        for step in range(30):
            page.mouse.move(x + step, y)
        until(lambda: studio.angle(2) > before + 5)
        other.evaluate(LISTEN)
        other.get_by_role("button", name="Ask for control").click()
        playwright.expect(page.get_by_text("asks for control")).to_be_visible()
        other.get_by_role("button", name="Take over").click()
        playwright.expect(page.get_by_text("took control")).to_be_visible()
        page.mouse.up()
        until(lambda: "lease.beat" in other.evaluate("window.sent"))


def test_a_stop_by_another_program_ends_what_is_held(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        page.evaluate(LISTEN)
        page.locator(".stage .seg").get_by_text("Robot").click()
        before = studio.angle(2)
        x, y = grab(page, 2)
        page.mouse.move(x + 60, y, steps=10)
        until(lambda: studio.angle(2) > before + 5)
        studio.board.stop()
        playwright.expect(page.get_by_text("The robot is stopped.")).to_be_visible()
        moves = page.evaluate("window.sent").count("move")
        page.mouse.move(x - 60, y, steps=20)
        page.mouse.up()
        assert is_stopped(studio)
        page.get_by_role("button", name="Start all servos").click()
        until(lambda: all(servo.is_start for servo in studio.board.servos()))
        assert page.evaluate("window.sent").count("move") == moves


def test_a_preview_moves_nothing_until_it_is_held(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        before = studio.angle(2)
        x, y = grab(page, 2)
        page.mouse.move(x + 60, y, steps=10)
        page.mouse.up()
        hold = page.get_by_role("button", name="Hold to move")
        playwright.expect(page.get_by_text("1 not sent")).to_be_visible()
        assert studio.angle(2) == before
        hold.hover()
        page.mouse.down()
        until(lambda: studio.angle(2) > before + 20)
        page.mouse.up()


def test_escape_stops_all_servos(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url) as page:
        playwright.expect(page.locator(".sv")).to_have_count(16)
        page.locator(".stage .seg").get_by_text("Robot").click()
        page.keyboard.press("Escape")
        playwright.expect(page.get_by_text("Stopped", exact=True)).to_be_visible()
        assert is_stopped(studio)
        page.get_by_role("button", name="Start all servos").click()
        until(lambda: all(servo.is_start for servo in studio.board.servos()))


def test_a_page_that_freezes_while_it_moves_the_robot_stops_it_and_says_so(studio: Studio, browser: Any) -> None:
    with opened(browser, studio.url, patient=False) as page:
        page.locator(".stage .seg").get_by_text("Robot").click()
        before = studio.angle(2)
        x, y = grab(page, 2)
        for step in range(30):
            page.mouse.move(x + step, y)
        until(lambda: studio.angle(2) > before + 5 or is_stopped(studio))
        page.evaluate("() => { const end = performance.now() + 1500; while (performance.now() < end); }")  # frozen
        until(lambda: is_stopped(studio))
        page.mouse.up()
        playwright.expect(page.get_by_text("The robot is stopped.")).to_be_visible()
        page.get_by_role("button", name="Start all servos").click()
        until(lambda: all(servo.is_start for servo in studio.board.servos()))


def test_a_hostile_caption_is_shown_as_text(studio: Studio, browser: Any) -> None:
    from servolink import ServoParameter

    studio.board.add_servo_parameters([ServoParameter(2, 0, "<img src=x>\u202egnp")])
    with opened(browser, studio.url) as page:
        playwright.expect(page.get_by_role("button", name="<img src=x>\\u202egnp")).to_be_visible()


# --- attacks ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def other_site(tmp_path: Path) -> Iterator[str]:
    """Serve an empty page on another port of this machine."""
    (tmp_path / "index.html").write_text("<!doctype html><title>other</title>")
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(tmp_path))
    handler.log_message = lambda *_: None  # type: ignore[attr-defined]
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


_OPEN_SOCKET = """url => new Promise(resolve => {
  const socket = new WebSocket(url);
  socket.onopen = () => resolve("open");
  socket.onerror = () => resolve("refused");
})"""


def test_a_page_of_another_port_gets_no_socket(studio: Studio, browser: Any, other_site: str) -> None:
    page = browser.new_page()
    page.goto(other_site)
    assert page.evaluate(_OPEN_SOCKET, studio.origin.replace("http", "ws") + "/ws") == "refused"


def test_a_name_that_leads_here_is_misdirected(studio: Studio, browser: Any) -> None:
    place = f"{OF_OTHERS}:{studio.origin.rpartition(':')[2]}"
    page = browser.new_page()
    response = page.goto(f"http://{place}/")
    assert response.status == 421
    assert page.evaluate(_OPEN_SOCKET, f"ws://{place}/ws") == "refused"


def test_no_page_shows_the_studio_in_a_frame(studio: Studio, browser: Any, other_site: str) -> None:
    page = browser.new_page()
    page.goto(other_site)
    page.evaluate(
        "url => new Promise(done => { const frame = document.createElement('iframe'); frame.onload = done;"
        " frame.src = url; document.body.append(frame) })",
        studio.url,
    )
    assert not any(frame.url.startswith(studio.origin) and frame.query_selector("#app") for frame in page.frames)


def test_what_the_hub_finds_wrong_is_said_until_it_is_put_away(studio: Studio, browser: Any) -> None:
    pipes: list[Any] = []

    def between(pipe: Any) -> None:
        pipe.connect_to_server()
        pipes.append(pipe)

    with opened(browser, studio.url) as page:
        page.route_web_socket("**/ws", between)
        page.reload()
        playwright.expect(page.locator(".sv")).to_have_count(16)
        main = page.locator(".screen").bounding_box()
        pipes[-1].send('{"jsonrpc": "2.0", "method": "problem", "params": {"text": "<b>hot</b>\\u202e"}}')
        playwright.expect(page.get_by_text("<b>hot</b>\\u202e")).to_be_visible()
        note = page.locator(".status .note").bounding_box()
        assert page.locator(".screen").bounding_box() == main  # nothing moves
        assert note["y"] + note["height"] <= main["y"]  # and nothing is covered
        page.get_by_role("button", name="Close").click()
        playwright.expect(page.get_by_text("<b>hot</b>")).to_have_count(0)


_REACH_IN = """async ({ origin, token }) => {
  const address = `${origin}/#token=${token}`, loaded = (element) => new Promise((resolve) => {
    element.onload = () => resolve("loaded");
    element.onerror = () => resolve("refused");
    document.body.append(element);
  });
  const read = (init) => fetch(address, init).then((response) => response.text()).catch(() => "refused");
  return {
    read: await read(),
    posted: await read({ method: "POST", body: "stop" }),
    script: await loaded(Object.assign(document.createElement("script"), { src: `${origin}/app.js` })),
    style: await loaded(
      Object.assign(document.createElement("link"), { rel: "stylesheet", href: `${origin}/css/base.css` }),
    ),
    picture: await loaded(Object.assign(document.createElement("img"), { src: `${origin}/icon.svg` })),
  };
}"""


def test_another_site_reads_nothing_and_runs_nothing(studio: Studio, browser: Any, other_site: str) -> None:
    origin, _, token = studio.url.partition("/#token=")
    page = browser.new_page()
    page.goto(other_site.replace("127.0.0.1", OF_OTHERS))
    reached = page.evaluate(_REACH_IN, {"origin": origin, "token": token})
    assert set(reached.values()) == {"refused"}, reached


def test_a_secret_in_the_query_opens_nothing(studio: Studio, browser: Any) -> None:
    page = browser.new_page()
    page.goto(studio.url.replace("/#", "/?"))
    page.get_by_text("Open the address that the studio prints").wait_for()
    assert page.locator(".sv").count() == 0
