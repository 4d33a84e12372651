"""Pages of the documentation beside the studio."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from servolink.studio.docs_pages import docs_page, page_names

ROOT = Path(__file__).parents[2]
KEYS = ROOT / "servolink/studio/web/shell/keys.js"


def test_each_screen_links_to_a_page_that_there_is() -> None:
    linked = set(re.findall(r'"((?:how-to|tutorial)/[\w-]+)(?:#([\w-]+))?"', KEYS.read_text(encoding="utf-8")))
    assert len(linked) > 5
    for name, heading in linked:
        assert name in page_names()
        assert not heading or f'id="{heading}"' in docs_page(name).decode()


def test_links_lead_to_what_is_served_or_are_words_only() -> None:
    pages = {name: docs_page(name).decode() for name in page_names()}
    headings = {name: set(re.findall(r'id="([^"]*)"', page)) for name, page in pages.items()}
    for name, page in pages.items():
        for address in re.findall(r'href="([^"]*)"', page):
            if address.startswith("/docs/"):
                other, _, heading = address.removeprefix("/docs/").partition("#")
                assert not heading or heading in headings[other], (name, address)
            else:
                assert address.startswith(("https://", "#", "/icon.svg", "/css/docs.css")), (name, address)


def test_a_page_has_notes_and_no_code_of_its_own() -> None:
    page = docs_page("how-to/build-a-board").decode()
    assert "<blockquote>" in page
    assert "<title>Build a board - servolink</title>" in page
    assert not re.search(r"<script|<img|style=|{warning}", page)


def test_a_page_in_chinese_says_so() -> None:
    assert b'<html lang="zh-Hant">' in docs_page("tutorial/quick-start-zh-hant")


@pytest.mark.parametrize("language", ["hans", "hant"])
def test_a_quick_start_in_chinese_explains_each_check_of_the_doctor(language: str) -> None:
    def checks(page: str) -> set[str]:
        rows = re.findall(r"^\| (`.+?`) \|", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.MULTILINE)
        return set(re.findall(r"`([^`]+)`", " ".join(rows)))

    assert len(checks("reference/doctor.md")) > 20
    assert checks(f"tutorial/quick-start-zh-{language}.md") == checks("reference/doctor.md")
