"""The pictures of the studio in these pages: `python -m docs.studio_pictures` takes them anew.

Needs Chromium, a font with Chinese characters and the extras `studio`, `browser` and `docs`. It does what the tutorial
says, so that they show that.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Locator, Page, ViewportSize, sync_playwright

from servolink import sync

PICTURES = Path(__file__).parent / "pictures/studio"
POSES = {"Arm out": {"R arm": 80}, "Up": {"R arm": 80, "R elbow": 75}, "Over": {"R arm": 80, "R elbow": 20}}
"""The actions of the tutorial: targets by servo, degrees."""
STACKS = [
    {
        "x": 24,
        "y": 24,
        "blocks": [
            {
                "type": "macro",
                "id": "hello",
                "caption": "Cheer",
                "blocks": [
                    {
                        "type": "pose",
                        "id": "high",
                        "caption": "Arm high",
                        "interval_ms": 800,
                        "blocks": [
                            {"type": "servo", "id": "arm", "servo_id": 2, "degree": 80},
                            {"type": "servo", "id": "elbow", "servo_id": 3, "degree": 60},
                        ],
                    },
                    {
                        "type": "repeat",
                        "id": "again",
                        "loop": 3,
                        "blocks": [
                            {"type": "run_action", "id": "over", "target": "action 3", "ratio_percent": 100},
                            {"type": "wait", "id": "pause", "delay_ms": 250},
                        ],
                    },
                    {"type": "if", "id": "sees", "servo_id": 1, "degree": 30, "blocks": []},
                ],
            }
        ],
    },
    {
        "x": 420,
        "y": 24,
        "blocks": [
            {
                "type": "button",
                "id": "eight",
                "button_id": 8,
                "event": "press",
                "blocks": [{"type": "run_macro", "id": "run", "target": "block hello", "ratio_percent": 100}],
            }
        ],
    },
]
"""The blocks of the picture, one of which no board can run."""
_SIZE = ViewportSize(width=1440, height=900)
_ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_UNHURRIED = """draw => {
  let now = 0;
  window.requestAnimationFrame = (then) => draw(() => then(now += 16));
}"""
"""Without a graphics card a figure takes long, and the page would draw it flat."""
_SETTLED = 700  # milliseconds
_JUDGED = 180_000  # milliseconds in which the twin has tried everything
_COLOURS = 256


def main() -> None:
    """Start the studio with its demo and take each picture."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with _studio() as url, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=_ARGUMENTS)
        page = browser.new_page(viewport=_SIZE, locale="en-GB", color_scheme="light", reduced_motion="reduce")
        page.add_init_script(f"({_UNHURRIED})(requestAnimationFrame.bind(window))")
        page.set_default_timeout(20_000)
        page.goto(url)
        take_live(page)
        take_live_in_chinese(page)
        build_poses(page)
        build_macro(page)
        put_on_button(page)
        plan(page)
        show_blocks(page)
        paste(page)
        fall(page)
        browser.close()


@contextmanager
def _studio() -> Iterator[str]:
    """Run the studio of a user who has not used it yet."""
    command = [sys.executable, "-m", "servolink", "studio", "--demo", "--no-browser"]
    with tempfile.TemporaryDirectory() as folder:
        for name in ("XDG_DATA_HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
            os.environ[name] = folder
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as studio:  # noqa: S603 - this program
            assert studio.stdout is not None  # noqa: S101 - narrows the type
            yield studio.stdout.readline().split()[1]
            studio.terminate()


def take_live(page: Page) -> None:
    """Show the robot after it has waved, in both themes."""
    page.get_by_role("button", name="R arm").click()
    with sync.connect("share://virtual") as board:
        for action in ("Stand", "Arm up", "Wave out", "Wave in", "Wave out", "Wave in"):
            board.run_action(action, wait=True)
    page.get_by_text("has control").first.wait_for(state="detached")
    take(page, "live")
    page.get_by_role("button", name="Light or dark").click()
    take(page, "live-dark")
    page.get_by_role("button", name="Light or dark").click()


def take_live_in_chinese(page: Page) -> None:
    """Show the same in the other languages, and return to English."""
    choice = page.locator("header .lang")
    for language in ("zh-Hans", "zh-Hant"):
        choice.select_option(language)
        take(page, f"live-{language}")
    choice.select_option("en")


def build_poses(page: Page) -> None:
    """Build three actions."""
    _show(page, "Actions")
    for name, targets in POSES.items():
        page.get_by_role("button", name="New action").click()
        _fill(page.get_by_label("Name", exact=True), name)
        for servo, degrees in targets.items():
            _fill(page.get_by_label(f"Target of {servo}", exact=True), str(degrees))
    take(page, "actions")


def build_macro(page: Page) -> None:
    """Build a macro of them."""
    _show(page, "Macros")
    page.get_by_role("button", name="New macro").click()
    _fill(page.get_by_label("Name", exact=True), "Greet")
    for name in ("Arm out", "Up", "Over", "Up", "Over", "Stand"):
        page.get_by_role("button", name="Add an action").click()
        page.get_by_role("dialog").get_by_role("button", name=name, exact=True).click()
    take(page, "macros")


def put_on_button(page: Page) -> None:
    """Make button 7 run the macro."""
    _show(page, "Buttons")
    page.get_by_role("button", name="Button 7").click()
    press = page.get_by_label("Press", exact=True)
    press.select_option(value=press.locator("option").filter(has_text="Greet").get_attribute("value"))
    take(page, "buttons")


def plan(page: Page) -> None:
    """See what writing would change."""
    _show(page, "Project")
    page.get_by_role("button", name="Write to the board").click(trial=True)
    take(page, "plan")


def paste(page: Page) -> None:
    """See on each size of page what pasting would add."""
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    _show(page, "Macros")
    page.locator(".insp").get_by_role("button", name="More").first.click()
    page.get_by_role("menuitem", name="Copy for another robot").click()
    page.get_by_role("button", name="Paste from another robot").click()
    page.get_by_label("R elbow").select_option("none")
    page.get_by_label("Time", exact=True).fill("150")
    page.get_by_label("Time", exact=True).press("Enter")
    for name, width, height in (("paste", 1440, 900), ("paste-tablet", 1024, 768), ("paste-phone", 390, 844)):
        page.set_viewport_size(ViewportSize(width=width, height=height))
        take(page, name)


def show_blocks(page: Page) -> None:
    """See blocks, and the reason why the board cannot run one of them."""
    _show(page, "Blocks")
    page.locator(".blocklyToolbox").wait_for()
    page.evaluate("async (stacks) => (await import('/state/blocks.js')).changeStacks(stacks)", STACKS)
    take(page, "blocks")


def fall(page: Page) -> None:
    """Bow too deeply, try it on the twin, and see what the plan says."""
    _show(page, "Actions")
    page.get_by_role("button", name="Bow").first.click()
    for servo, degrees in (("R thigh", 88), ("L thigh", -88)):
        _fill(page.get_by_label(f"Target of {servo}", exact=True), str(degrees))
    page.get_by_role("button", name="Try on the twin").click()
    page.get_by_text("The twin falls at").wait_for(timeout=_JUDGED)
    page.locator(".pose[aria-pressed=true] .verdict").wait_for(timeout=_JUDGED)
    take(page, "twin")
    _show(page, "Project")
    page.get_by_text("The twin falls in").wait_for(timeout=_JUDGED)
    page.get_by_text("still trying").wait_for(state="detached", timeout=_JUDGED)
    take(page, "twin-plan")


def _show(page: Page, screen: str) -> None:
    page.get_by_role("link", name=screen).click()


def _fill(field: Locator, text: str) -> None:
    field.fill(text)
    field.press("Enter")


def take(page: Page, name: str) -> None:
    """Take a picture, in as many colours as a page like this needs."""
    page.mouse.move(0, 0)
    page.wait_for_timeout(_SETTLED)
    path = PICTURES / f"{name}.png"
    page.screenshot(path=path)
    Image.open(path).convert("RGB").quantize(_COLOURS, Image.Quantize.FASTOCTREE).save(path, optimize=True)


if __name__ == "__main__":
    main()
