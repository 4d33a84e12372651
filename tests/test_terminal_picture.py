"""The pictures of terminals show what the commands print."""

from __future__ import annotations

import re
import sys

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")]


def texts(svg: str) -> list[str]:
    """Return the pieces of text in a picture, without numbers: they come from readings and clocks."""
    return [re.sub(r"[\d.]+", "-", text) for text in re.findall(r">([^<]+)</text>", svg)]


@pytest.mark.parametrize("name", ["demo", "watch", "plan"])
def test_the_picture_is_that_of_the_command(name: str) -> None:
    from docs.terminal_picture import FOLDER, picture

    committed = (FOLDER / f"{name}.svg").read_text(encoding="utf-8")
    assert texts(committed) == texts(picture(name)), "run `python -m docs.terminal_picture`"
