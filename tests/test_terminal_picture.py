"""The picture of the demo shows what the demo prints."""

from __future__ import annotations

import re
import sys

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")]


def texts(svg: str) -> list[str]:
    """Return the pieces of text in a picture, with the seconds that a movement took left out."""
    return [re.sub(r"\d\.\d(?=&#160;s)", "-", text) for text in re.findall(r">([^<]+)</text>", svg)]


def test_the_picture_is_that_of_the_demo() -> None:
    from docs import terminal_picture

    fresh = terminal_picture.draw(terminal_picture.steps(terminal_picture.run_demo(), 2, 6))
    committed = terminal_picture.PICTURE.read_text(encoding="utf-8")
    assert texts(committed) == texts(fresh), "run `python -m docs.terminal_picture`"
