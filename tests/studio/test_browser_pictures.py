"""Key screens look as they did: compared with pictures in tests/data/studio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.studio.browser import in_browser, show

pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
pytest.importorskip("PIL", reason="the extra docs is not installed")

from tests.studio.pictures import SCREENS, compare, find_difference, still

pytestmark = in_browser

_CHANGES = [
    (".insp", "visibility", "hidden"),
    (".insp", "translate", "8px"),
    (".insp .sid", "background", "none"),
    (".stop", "background", "gray"),
    (".rail svg", "visibility", "hidden"),
    (".plotcard button", "visibility", "hidden"),
]
"""Of the screen Live: a selector, a property of its style and a value."""


@pytest.mark.parametrize("size", SCREENS)
def test_key_screens_look_as_they_did(user: Path, browser: Any, size: str) -> None:
    found = {}
    with still(browser, size) as page:
        for screen in SCREENS[size]:
            show(page, screen)
            found[screen] = find_difference(page, screen, size)
    differing = {screen: place for screen, place in found.items() if place}
    assert differing == {}, "`python -m tests.studio.pictures` shows how they look now"


def test_what_is_missing_has_moved_or_lost_its_colour_is_found(user: Path, browser: Any) -> None:
    with still(browser, "tablet") as page:
        show(page, "Live")
        assert find_difference(page, "Live", "tablet") == ""
        for selector, name, value in _CHANGES:
            page.eval_on_selector(selector, "(element, [name, value]) => (element.style[name] = value)", [name, value])
            assert compare(page, "Live", "tablet"), (selector, name)
            page.eval_on_selector(selector, "(element, name) => (element.style[name] = '')", name)
        assert find_difference(page, "Live", "tablet") == ""
