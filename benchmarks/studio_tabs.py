"""Many pages of one studio, and one that is frozen while it moves the robot."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from time import perf_counter, sleep
from typing import Any

from benchmarks.studio_hands import clock_offset
from benchmarks.studio_place import Place, page_of

TABS = 20
PAGES = 4
"""Of these tabs, so many are whole pages. The others are WebSockets that ask for the same and acknowledge it."""

_SOCKETS = """async ([count, token, hz]) => {
  window.readings = 0;
  const url = `ws://${location.host}/ws`;
  await Promise.all(Array.from({ length: count }, () => new Promise((done) => {
    const socket = new WebSocket(url);
    let id = 0;
    const tell = (method, params) => socket.send(JSON.stringify({ jsonrpc: "2.0", method, params }));
    socket.onopen = () => socket.send(JSON.stringify({ token }));
    socket.onmessage = ({ data }) => {
      const { method, params } = JSON.parse(data);
      if (id === 0) socket.send(JSON.stringify({ jsonrpc: "2.0", id: ++id, method: "servos.watch", params: { hz } }));
      if (method !== "servos") return;
      window.readings++;
      tell("servos.ack", { number: params.number });
      done();
    };
  })));
}"""


@dataclass(frozen=True)
class Tabs:
    """What many tabs get, and what they cost."""

    readings: float
    """That each of the WebSockets got per second, on average."""
    cpu: float
    """Share of a core that the server used."""
    memory: float
    """MB."""


@dataclass(frozen=True)
class Frozen:
    """What a frozen page did and cost."""

    stopped: float
    """Seconds from its last beat until the robot was stopped."""
    cpu: float
    """Share of a core that the server used for it, over that without any page."""
    memory: float
    """MB by which the server grew meanwhile."""


def watch(place: Place, browser: Any, hz: int, seconds: float) -> Tabs:
    """Open all tabs, and count what they get."""
    with ExitStack() as stack:
        for _ in range(PAGES):
            stack.enter_context(page_of(browser, place.url))
        others = browser.new_page()
        stack.callback(others.close)
        others.goto(f"{place.origin}/vendor/LICENCES.txt")
        others.evaluate(_SOCKETS, [TABS - PAGES, place.token, hz])
        began, before, used = perf_counter(), others.evaluate("readings"), place.cpu()
        others.wait_for_timeout(seconds * 1000)
        after, now, cpu = others.evaluate("readings"), perf_counter(), place.cpu()
        readings = (after - before) / (TABS - PAGES) / (now - began)
        return Tabs(readings, (cpu - used) / (now - began), place.memory())


def freeze(place: Place, browser: Any, seconds: float) -> Frozen:
    """Stop the processes of a page that moves the robot, and look at what the server does."""
    idle = _cpu_share(place, seconds)
    with page_of(browser, place.url) as page:
        page.locator(".stage .seg").get_by_text("Robot").click()
        where = page.get_by_label("Target of servo 2,").bounding_box()
        page.mouse.move(where["x"] + where["width"] / 2, where["y"] + where["height"] / 2)
        page.mouse.down()
        page.get_by_text("You have control").wait_for()
        page.mouse.move(where["x"] + where["width"] - 4, where["y"] + where["height"] / 2, steps=8)
        offset = clock_offset(page)
        place.seen_until_now()
        with _stopped(browser):
            stop = next(time for time, targets in iter(place.seen.get, None) if not targets)
            before = place.memory()
            cpu = _cpu_share(place, seconds)
            grown = place.memory() - before
        beats = [offset + beat / 1000 for beat in page.evaluate("probe.beats")]
        page.mouse.up()
    return Frozen(stop - max(beat for beat in beats if beat < stop), cpu - idle, grown)


@contextmanager
def _stopped(browser: Any) -> Iterator[None]:
    """Stop all processes that run pages."""
    processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    numbers = [one["id"] for one in processes if one["type"] == "renderer"]
    for number in numbers:
        os.kill(number, signal.SIGSTOP)
    try:
        yield
    finally:
        for number in numbers:
            os.kill(number, signal.SIGCONT)


def _cpu_share(place: Place, seconds: float) -> float:
    """Return the share of a core that the server uses in the next `seconds`."""
    began, used = perf_counter(), place.cpu()
    sleep(seconds)
    return (place.cpu() - used) / (perf_counter() - began)
