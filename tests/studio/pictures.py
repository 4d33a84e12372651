"""Pictures of key screens and their comparison: `python -m tests.studio.pictures` takes the references again.

A reference is a quarter of the page's width and height, in 256 colours. Means of blocks are compared, so that an edge
that is smoothed differently passes and a panel that has moved does not.
"""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image, ImageChops
from playwright.sync_api import sync_playwright

from tests.studio.browser import CHROMIUM, OPTIONS, opened, running, show

SCREENS = {"tablet": ("Live", "Actions", "Macros", "Buttons", "Project", "Board"), "phone": ("Live",)}
"""What is compared on which size."""
_REFERENCES = Path(__file__).parents[1] / "data/studio"
_SCALE = 4
_COLOURS = 256
_BLOCK = 16  # pixels of the page
_TOLERANCE = 16  # of 255, in each of red, green and blue; the few colours of a reference take up to 9
_ATTEMPTS = 50  # of about 0.1 s
_SETTLED = 1000  # milliseconds

_STILL = """() => {
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(`
    .live canvas, .plot, .chip[title=Battery], .insp dd, [data-part=meters] i, .conn dd { visibility: hidden }
    .mono, .cmd code, span:has(> .lang) { visibility: hidden }
    .verdict { visibility: hidden }
    .side .twin { display: none }
    .conn .bd2:not(.on), .conn ul + p, .conn > :last-child > :first-child > :is(div, p) { display: none }
  `);
  document.adoptedStyleSheets.push(sheet);
}"""
"""Hides what changes by itself, what is set in a font of the system, and what depends on the machine's ports."""


@contextmanager
def still(browser: Any, size: str) -> Iterator[Any]:
    """Open a page of a new studio that shows nothing that changes by itself; on a tablet, with an unwritten action."""
    with running("studio", "--demo") as url, opened(browser, url, size) as page:
        page.emulate_media(reduced_motion="reduce")
        page.evaluate(_STILL)
        if size == "tablet":
            show(page, "Actions")
            page.get_by_role("button", name="New action").click()
            page.get_by_label("Name", exact=True).fill("Arm out")
            page.get_by_label("Name", exact=True).press("Enter")
        yield page


def find_difference(page: Any, screen: str, size: str) -> str:
    """Return where the page differs from the reference; empty if it does not, or no longer after some time."""
    place = ""
    for _ in range(_ATTEMPTS):
        place = compare(page, screen, size)
        if not place:
            break
    return place


def compare(page: Any, screen: str, size: str) -> str:
    """Return where the page differs from the reference now; empty if nowhere."""
    with Image.open(_reference(screen, size)) as reference:
        expected = reference.convert("RGB").reduce(_BLOCK // _SCALE)
    found = _take(page).reduce(_BLOCK // _SCALE)
    if found.size != expected.size:
        return f"{found.size} blocks, not {expected.size}"
    beyond = [0] * (_TOLERANCE + 1) + [1] * (255 - _TOLERANCE)
    box = ImageChops.difference(found, expected).point(beyond * 3).getbbox()
    return "" if box is None else "x {} to {}, y {} to {}".format(*(_BLOCK * box[at] for at in (0, 2, 1, 3)))


def main() -> None:
    """Take the references again."""
    _REFERENCES.mkdir(exist_ok=True)
    with sync_playwright() as driver, driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS) as browser:
        for size, screens in SCREENS.items():
            with _new_user(), still(browser, size) as page:
                for screen in screens:
                    show(page, screen)
                    page.wait_for_timeout(_SETTLED)
                    picture = _take(page).quantize(_COLOURS, Image.Quantize.MEDIANCUT, kmeans=4)
                    picture.save(_reference(screen, size), optimize=True)


def _take(page: Any) -> Image.Image:
    page.mouse.move(0, 0)
    picture = page.screenshot(animations="disabled", caret="hide")
    return Image.open(io.BytesIO(picture)).convert("RGB").reduce(_SCALE)


def _reference(screen: str, size: str) -> Path:
    return _REFERENCES / f"{screen.lower()}-{size}.png"


@contextmanager
def _new_user() -> Iterator[None]:
    with tempfile.TemporaryDirectory() as folder:
        for name in ("XDG_DATA_HOME", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
            os.environ[name] = folder
        yield


if __name__ == "__main__":
    main()
