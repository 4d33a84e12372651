"""The pictures of a class in the studio: `python -m docs.fleet_pictures` takes them anew, on each size of page.

Needs mosquitto, Chromium and the extras `studio`, `fleet`, `browser` and `docs`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import ViewportSize, sync_playwright

from docs.studio_pictures import take
from tests.fleet.mosquitto import Broker
from tests.studio.browser import CHROMIUM, OPTIONS
from tests.studio.classroom import classroom

_SIZES = {
    "fleet": ViewportSize(width=1440, height=900),
    "fleet-tablet": ViewportSize(width=1024, height=768),
    "fleet-phone": ViewportSize(width=390, height=844),
}
_GROUPS = '[groups]\nfront = ["ann", "ben", "cleo"]\nback = ["hal", "ida"]\n'


def main() -> None:
    """Let a class join a broker, and choose a group on the page of the teacher."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("XDG_DATA_HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
            os.environ[name] = folder
        (Path(folder) / "servolink").mkdir()
        (Path(folder) / "servolink/fleet.toml").write_text(_GROUPS, encoding="utf-8")
        broker = Broker(Path(folder))
        broker.start()
        try:
            with classroom(
                broker, ann="run", ben="run", cleo="run", dora="watch", emil="run", finn="run", gina="run", hal="run",
                ida="run", jon="run", kim="watch", lea="run",
            ):  # fmt: skip
                _take_all(broker)
        finally:
            broker.end()


def _take_all(broker: Broker) -> None:
    command = [sys.executable, "-m", "servolink", "studio", "--demo", "--no-browser", "--fleet", broker.url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as studio, sync_playwright() as driver:  # noqa: S603 - this program
        assert studio.stdout is not None  # noqa: S101 - narrows the type
        url = studio.stdout.readline().split()[1]
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        for name, size in _SIZES.items():
            page = browser.new_page(viewport=size, locale="en-GB", color_scheme="light", reduced_motion="reduce")
            page.goto(url)
            page.locator(".banner").wait_for()
            page.evaluate("location.hash = 'fleet'")
            page.locator(".tile").nth(11).wait_for()
            page.get_by_role("button", name="front (3)").click()
            page.get_by_label("What to run").wait_for()
            take(page, name)
            page.close()
        browser.close()
        studio.terminate()


if __name__ == "__main__":
    main()
