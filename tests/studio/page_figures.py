"""Figures of the page without a server, as ratios in one run: `python -m tests.studio.page_figures [FOLDER]`.

Needs Chromium, npm and the extra `browser`; builds the page unless FOLDER has a built one. Both sides of a ratio are
measured in turns on the same machine: the page in Chromium, and the same studio in CPython, or Pyodide alone.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import sync_playwright

from servolink.studio.worker_door import WorkerDoor
from tests.processes import finish, run, start
from tests.studio.board_program import BoardProgram
from tests.studio.browser import CHROMIUM, OPTIONS
from tests.studio.page_server import SERIAL, PageServer
from tests.studio.test_browser_page import START, served, visit
from tests.studio.test_browser_ports import connect

ROUNDS = 3
WATCHED = 10  # seconds of readings in a round
REQUESTS = 200  # of a round
HZ = 50
BARE = """
const bare = new Worker("bare.js", { type: "module" });
bare.onmessage = () => (window.started = performance.now());
"""
BARE_WORKER = """
import { loadPyodide } from "./python/runtime/pyodide.mjs";
await loadPyodide({ indexURL: new URL("./python/runtime/", import.meta.url).href });
postMessage(0);
"""
TALK = """async () => {
  const { WorkerLine } = await import("./link/worker-line.js");
  const line = new WorkerLine();
  const waiting = new Map();
  const talk = { onReading: () => {} };
  talk.call = (method, params = {}) => new Promise((resolve) => {
    waiting.set(waiting.size + 1, resolve);
    line.send(JSON.stringify({ jsonrpc: "2.0", id: waiting.size, method, params }));
  });
  return new Promise((resolve) => {
    line.onopen = () => line.send(JSON.stringify({ token: "", who: "figures" }));
    line.onmessage = ({ data }) => {
      const { id, method, params, result } = JSON.parse(data);
      if (method === "servos") {
        line.send(JSON.stringify({ jsonrpc: "2.0", method: "servos.ack", params: { number: params.number } }));
        talk.onReading(params.servos);
      } else if (waiting.has(id)) waiting.get(id)(result);
      else if (method === undefined) resolve(talk);
    };
  });
}"""
MOVES = f"""async () => {{
  const talk = await ({TALK})();
  await talk.call("servos.watch", {{ hz: {HZ} }});
  talk.call("move", {{ targets: {{ 1: 30 }}, duration: 0.1 }});
  let first = null;
  return new Promise((resolve) => {{
    talk.onReading = (servos) => {{
      const {{ angle }} = servos.find((servo) => servo.servo_id === 1);
      first ??= angle;
      if (Math.abs(angle - first) > 1) resolve(performance.now());
    }};
  }});
}}"""
ASKS = f"""async (count) => {{
  const talk = await ({TALK})();
  const took = [];
  for (let number = 0; number < count; number++) {{
    const began = performance.now();
    await talk.call("battery");
    took.push(performance.now() - began);
  }}
  return took.sort((one, other) => one - other)[count / 2];
}}"""
COUNT = """async () => {
  const { readAt } = await import("./state/robot.js");
  window.readings = 0;
  readAt.subscribe(() => void window.readings++);
}"""
SPARE = """async () => {
  const code = await import("./state/code.js");
  const until = (signal, is) => new Promise((resolve) => void signal.subscribe((value) => is(value) && resolve()));
  const isReady = () => until(code.isReady, (value) => value);
  const began = performance.now();
  code.prepareProgram();
  await isReady();
  const ready = performance.now();
  code.changeProgram("print(1)");
  await code.runProgram({ makeWay: async () => {} });
  await until(code.course, (value) => value !== "running");
  const ended = performance.now();
  await isReady();
  return [ready - began, performance.now() - ended];
}"""


class Native:
    """The studio in CPython, with one page."""

    def __init__(self) -> None:
        self.readings = 0
        self._answers: asyncio.Queue[str] = asyncio.Queue()

    async def measure(self, address: str, asks: int) -> dict[str, float]:
        """Return the median time of requests, or the CPU of a reading, in seconds."""
        self._door = WorkerDoor(self._post)
        await self._door.begin(address)
        self._door.take("open", 1, json.dumps({"token": "", "who": "figures"}))
        await self._answers.get()
        await self._ask("servos.watch", hz=HZ)
        if asks:
            return {"request": median([await self._ask("battery") for _ in range(asks)])}
        await asyncio.sleep(2)
        began, self.readings = time.process_time(), 0
        await asyncio.sleep(WATCHED)
        return {"cpu": (time.process_time() - began) / self.readings, "rate": self.readings / WATCHED}

    async def _ask(self, method: str, **params: Any) -> float:
        began = time.perf_counter()
        self._tell(method, params, id=1)
        await self._answers.get()
        return time.perf_counter() - began

    def _tell(self, method: str, params: dict[str, Any], **more: Any) -> None:
        self._door.take("message", 1, json.dumps({"jsonrpc": "2.0", "method": method, "params": params, **more}))

    def _post(self, _kind: str, _number: int, text: str) -> None:
        if reading := re.match(r'\{"jsonrpc":"2.0","method":"servos","params":\{.*?"number":(\d+)', text):
            self.readings += 1
            self._tell("servos.ack", {"number": int(reading[1])})
        elif '"method":' not in text:
            self._answers.put_nowait(text)


def native(address: str, asks: int = 0) -> dict[str, float]:
    """Measure in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        homes = dict.fromkeys(("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME"), folder)
        done = run(
            [sys.executable, "-m", __spec__.name, "native", address, str(asks)], check=True, env=os.environ | homes
        )
    return dict(json.loads(done.stdout))


def worker_cpu() -> float:
    """Return the seconds of CPU of all workers of pages of this machine's Chromium."""
    ticks = 0
    for place in Path("/proc").glob("[0-9]*/task/[0-9]*/stat"):
        try:
            name, _, rest = place.read_text().partition("(")[2].rpartition(") ")
        except OSError:
            continue
        if name.startswith("DedicatedWorker"):
            ticks += sum(map(int, rest.split()[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def readings(browser: Any, url: str) -> dict[str, float]:
    """Return the CPU of a reading in the worker of the page, in seconds."""
    page = browser.new_page()
    page.goto(f"{url}#live")
    page.locator(".sv [data-part=angle]").first.wait_for(timeout=START)
    page.evaluate(COUNT)
    page.wait_for_timeout(5000)
    began, before = worker_cpu(), page.evaluate("readings")
    page.wait_for_timeout(WATCHED * 1000)
    cpu, count = worker_cpu() - began, page.evaluate("readings") - before
    page.close()
    return {"cpu": cpu / count, "rate": count / WATCHED}


@contextmanager
def pseudo_terminal() -> Iterator[str]:
    """Serve a virtual board at a pseudo-terminal; yield the address."""
    program = start([sys.executable, "-m", "servolink", "virtual"])
    assert program.stdout is not None
    yield f"serial://{program.stdout.readline().split()[-1].removeprefix('serial://')}"
    finish(program, signal.SIGKILL)


def request(browser: Any, server: PageServer) -> float:
    """Return the median time of requests of the page to a board at its port, in seconds."""
    page = browser.new_context().new_page()
    page.add_init_script(SERIAL)
    page.goto(f"{server.url}#board")
    connect(page)
    took = float(page.evaluate(ASKS, REQUESTS)) / 1000
    page.context.close()
    return took


def starts(context: Any, url: str) -> dict[str, float]:
    """Return the seconds from a navigation to Python alone, and to a robot that moves; all files are kept."""
    page = context.new_page()
    page.goto(f"{url}bare.html", wait_until="commit")
    page.wait_for_function("window.started", timeout=START)
    bare = page.evaluate("window.started")
    page.goto(f"{url}#live", wait_until="commit")
    moved = page.evaluate(MOVES)
    page.close()
    return {"bare": bare / 1000, "moved": moved / 1000}


def spare(context: Any, url: str) -> dict[str, float]:
    """Return the seconds until a program can run: at first, and after the end of a short program."""
    page = context.new_page()
    page.goto(f"{url}#live")
    page.locator(".sv [data-part=angle]").first.wait_for(timeout=START)
    ready, again = page.evaluate(SPARE)
    page.close()
    return {"ready": ready / 1000, "again": again / 1000}


def compare(name: str, ours: list[float], theirs: list[float], unit: str, scale: float) -> None:
    """Print a line of the table: both medians, and the median of the ratios, with the least and the most."""
    ratios = sorted(one / other for one, other in zip(ours, theirs, strict=True))
    sides = " | ".join(f"{median(each) * scale:.2f} {unit}" for each in (ours, theirs))
    print(f"| {name} | {sides} | {median(ratios):.1f} | {ratios[0]:.1f} to {ratios[-1]:.1f} |", flush=True)


def measure(folder: Path) -> None:
    """Measure the page in a folder, and print a table."""
    (folder / "bare.html").write_text('<!doctype html><script src="bare-page.js"></script>', encoding="utf-8")
    (folder / "bare-page.js").write_text(BARE, encoding="utf-8")
    (folder / "bare.js").write_text(BARE_WORKER, encoding="utf-8")
    print("| | page | beside it | ratio | of rounds |\n|---|---|---|---|---|")
    with sync_playwright() as driver, served(folder) as port, tempfile.TemporaryDirectory() as place:
        url = f"http://127.0.0.1:{port}/{folder.name}/"
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        context = browser.new_context(locale="en-GB")
        visit(context.new_page(), url)
        for page in context.pages:
            page.close()
        begun = [starts(context, url) | spare(context, url) for _ in range(ROUNDS)]
        bare = [each["bare"] for each in begun]
        compare("start to a moving robot, beside Pyodide alone", [each["moved"] for each in begun], bare, "s", 1)
        compare("first program ready, beside Pyodide alone", [each["ready"] for each in begun], bare, "s", 1)
        compare("next program ready after a short one", [each["again"] for each in begun], bare, "s", 1)
        read = [(readings(context, url), native("virtual://?servos=16")) for _ in range(ROUNDS)]
        rates = ", ".join(f"{median(each[side]['rate'] for each in read):.1f}" for side in (0, 1))
        costs = [[each[side]["cpu"] for each in read] for side in (0, 1)]
        compare(f"CPU of a reading of 16 servos ({rates} a second)", costs[0], costs[1], "ms", 1000)
        board = BoardProgram(Path(place))
        server = PageServer(folder, board.url)
        with pseudo_terminal() as address:
            asked = [(request(browser, server), native(address, REQUESTS)["request"]) for _ in range(ROUNDS)]
        compare("request to a port", [one for one, _ in asked], [other for _, other in asked], "ms", 1000)
        server.close()
        board.kill()
        browser.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["native"]:
        print(json.dumps(asyncio.run(Native().measure(sys.argv[2], int(sys.argv[3])))))
    else:
        with tempfile.TemporaryDirectory() as work:
            target = Path(work) / "page"
            if sys.argv[1:]:
                shutil.copytree(sys.argv[1], target)
            else:
                print(run([sys.executable, ".ci/page", str(target)], check=True, limit=600).stdout)
            measure(target)
