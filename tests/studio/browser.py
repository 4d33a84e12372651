"""A studio in a real browser, for tests: Debian's Chromium, driven by Playwright."""

from __future__ import annotations

import re
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from servolink import sync
from servolink.studio import start as start_module
from tests.processes import finish, start

DEMO = Path(start_module.__file__).with_name("demo.servolink.json")
"""The project of the virtual board."""
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
IN_THE_NETWORK, OF_OTHERS = "robot.test", "evil.example"
"""Names that lead here: one under which the studio may be allowed, and one that is none of its own."""
OPTIONS = [
    "--no-sandbox",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-gpu",
    f"--host-resolver-rules=MAP {IN_THE_NETWORK} 127.0.0.1,MAP {OF_OTHERS} 127.0.0.1",
]
PATIENCE = 30_000  # milliseconds that a page may take on the slowest machine
_FILLED = {
    "Live": ".sv [data-part=angle]",
    "Actions": ".pose",
    "Macros": ".mrow",
    "Buttons": ".asg",
    "Teach": ".screen .card",
    "Blocks": ".blocklyToolbox",
    "Record": ".rec .plot canvas",
    "Project": ".screen h2",
    "Board": ".screen h2",
    "Servos": ".servos .mrow",
}
"""What each screen shows when it knows what is on the board."""
SCREENS = tuple(_FILLED)
SIZES = {"desktop": (1440, 900), "tablet": (1024, 768), "phone": (390, 844)}

NARROW = {"zoomed": (720, 450), "upright": (768, 1024)}
"""Sizes of the page on a desktop at 200 % zoom, and on a tablet that is held upright."""

in_browser = [pytest.mark.browser, pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")]

# Without a graphics card the browser calculates every pixel of WebGL: too slow for the beats of a busy machine.
_FLAT = """HTMLCanvasElement.prototype.getContext = (original => function (kind, ...more) {
  return kind === "webgl2" ? null : original.call(this, kind, ...more);
})(HTMLCanvasElement.prototype.getContext)"""

# A busy machine may keep a page from its beats for a while. That the robot is stopped then is a test of its own.
_PATIENT = """WebSocket.prototype.send = (original => function (text) {
  return original.call(this, text.replace('"dead_man":0.35', '"dead_man":30'));
})(WebSocket.prototype.send)"""

LISTEN = """() => {
  const send = WebSocket.prototype.send;
  window.sent = [];
  WebSocket.prototype.send = function (text) {
    window.sent.push(JSON.parse(text).method);
    return send.call(this, text);
  };
}"""
"""Remembers the names of the methods that a page calls, in `window.sent`."""
_NO_RULES = ["skip-link"]  # takes a link to a screen for one, when the row of links is scrolled
_AXE = """async leftOut => {
  const rules = Object.fromEntries(leftOut.map(id => [id, { enabled: false }]));
  const { violations } = await axe.run(document, { resultTypes: ["violations"], rules });
  return violations.map(({ id, impact, nodes }) => `${impact} ${id}: ${nodes.map(({ html }) => html).join("; ")}`);
}"""


class Studio(NamedTuple):
    """A studio that runs."""

    url: str
    """With the token that lets a page do everything."""
    board: sync.Board
    """What other programs see of its board."""

    @property
    def origin(self) -> str:
        """The address of the page without the token."""
        return self.url.partition("/#")[0]

    def angle(self, servo_id: int) -> int:
        """Return where a servo is."""
        return int(self.board.servo(servo_id).angle)


def new_profile(browser: Any, size: str = "desktop", theme: str = "light", locale: str = "en-GB") -> Any:
    """Return a user of the browser, who has used it for nothing yet."""
    width, height = (SIZES | NARROW)[size]
    return browser.new_context(viewport={"width": width, "height": height}, locale=locale, color_scheme=theme)


@contextmanager
def running(*arguments: str) -> Iterator[str]:
    """Run a studio; yield its address. It must end without a word."""
    program = start([sys.executable, "-m", "servolink", *arguments, "--no-browser"])
    assert program.stdout is not None
    line = program.stdout.readline()
    assert line.startswith("studio http"), finish(program)
    yield line.split()[1]
    _, said = finish(program, signal.SIGTERM)
    assert (program.returncode, said) == (0, "ended: the board was left unchanged\n")


@contextmanager
def opened(
    browser: Any,
    url: str,
    size: str = "desktop",
    theme: str = "light",
    *,
    profile: Any = None,
    loss: bool = False,
    patient: bool = True,
) -> Iterator[Any]:
    """Open a page of the studio, in a new `profile` unless one is given; it must report no error.

    With `loss`, the studio may be killed meanwhile. Unless `patient`, the robot is stopped as soon as it is for people,
    when the page beats too seldom. Under a name of the network browsers ignore one of the headers.
    """
    page = (profile or new_profile(browser, size, theme)).new_page()
    page.add_init_script(_FLAT)
    if patient:
        page.add_init_script(_PATIENT)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    expected = ["The Cross-Origin-Opener-Policy header has been ignored"]
    if loss:  # a killed studio answers no WebSocket, and gives no screen that was not loaded yet
        expected += ["WebSocket", "Failed to load resource: net::ERR_CONNECTION_REFUSED"]
    page.goto(url)
    yield page
    page.close()
    left = [error for error in errors if not error.startswith(tuple(expected))]
    assert left == [], left


def go(page: Any, screen: str) -> None:
    """Go to a screen; on a phone it may be in the list of the other screens."""
    page.locator(".rail a").first.wait_for(state="attached")
    entry = page.get_by_role("link", name=re.compile(f"^{screen}")).locator("visible=true")
    if entry.count() == 0:
        page.locator(".others > button").click()
    entry.click()


def show(page: Any, screen: str, *, by_address: bool = False) -> None:
    """Go to a screen, and wait until it shows what the board holds. Its address is the same in each language."""
    if by_address:
        page.evaluate("name => location.hash = name", screen.lower())
    else:
        go(page, screen)
    page.locator(_FILLED[screen]).first.wait_for()


def grab(page: Any, servo_id: int) -> tuple[float, float]:
    """Press the mouse on the slider of a servo, where it stands, and return the place."""
    slider = page.get_by_label(f"Target of servo {servo_id},")
    place = slider.bounding_box()
    low, high = (float(slider.get_attribute(name)) for name in ("min", "max"))
    value = float(slider.input_value())
    x = place["x"] + (value - low) / (high - low) * place["width"]
    y = place["y"] + place["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    return x, y


def is_stopped(studio: Studio) -> bool:
    """Return whether no servo can move."""
    return not any(servo.is_start for servo in studio.board.servos())


def found_by_axe(page: Any) -> Any:
    """Return the violations on a page into which axe-core was loaded."""
    return page.evaluate(_AXE, _NO_RULES)
