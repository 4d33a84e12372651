"""The pictures of the studio in these pages: `python -m docs.studio_pictures` takes them anew.

Needs Chromium and the extras `studio` and `browser`.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import Page, ViewportSize, sync_playwright

from servolink import sync

PICTURES = Path(__file__).parent / "pictures/studio"
_SIZE = ViewportSize(width=1440, height=900)
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_SETTLED = 500  # milliseconds


def main() -> None:
    """Start the studio with its demo and take each picture."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "servolink", "studio", "--demo", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as studio:  # noqa: S603 - this program
        assert studio.stdout is not None  # noqa: S101 - narrows the type
        url = studio.stdout.readline().split()[1]
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=_ARGUMENTS)
            page = browser.new_page(viewport=_SIZE, locale="en-GB", color_scheme="light")
            page.goto(url)
            _take_live(page)
            browser.close()
        studio.terminate()


def _take_live(page: Page) -> None:
    page.get_by_role("button", name="R arm").click()
    with sync.connect("share://virtual") as board:
        for action in ("Stand", "Arm up", "Wave out", "Wave in", "Wave out", "Wave in"):
            board.run_action(action, wait=True)
    page.get_by_text("has control").first.wait_for(state="detached")
    page.wait_for_timeout(_SETTLED)
    page.screenshot(path=PICTURES / "live.png")


if __name__ == "__main__":
    main()
