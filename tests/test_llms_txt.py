"""llms.txt: every page of the documentation once, in the order of the index, with one line about it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.command_pages import names
from docs.llms_txt import FOLDER, read, text, toctrees
from docs.made_pages import MADE

LINE = re.compile(r"- \[([^\]]+)\]\(_sources/(\S+)\.md\.txt\): (\S.*)")
SITE = FOLDER / "_build"


def entries() -> list[tuple[str, str, str]]:
    lines = [line for line in text().splitlines() if line and not line.startswith(("#", ">"))]
    found = [LINE.fullmatch(line) for line in lines]
    assert all(found), [line for line, match in zip(lines, found, strict=True) if match is None]
    return [(match[1], match[2], match[3]) for match in found if match is not None]


def test_every_page_is_listed_once_with_a_line() -> None:
    listed = [name for _, name, _ in entries()]
    written = {
        path.relative_to(FOLDER).with_suffix("").as_posix()
        for path in FOLDER.rglob("*.md")
        if not {"_build", "examples", "commands"} & set(path.relative_to(FOLDER).parts)
    } | {path.relative_to(FOLDER).with_suffix("").as_posix() for path in MADE if path.suffix == ".md"}
    assert len(listed) == len(set(listed))
    assert set(listed) == written - {"index"} | {f"reference/commands/{name}" for name in ("index", *names())}


def test_it_begins_with_what_servolink_is_and_goes_on_as_the_index() -> None:
    lines = text().splitlines()
    assert lines[0] == "# servolink"
    assert lines[2].startswith("> servolink drives servo control boards")
    assert [line[3:] for line in lines if line.startswith("## ")] == [caption for caption, _ in toctrees("index")]


def test_a_guide_says_at_its_head_for_whom_it_is() -> None:
    guides = [read(name) for _, name, _ in entries() if name.startswith("how-to/")]
    assert len(guides) > 30
    assert [page.name for page in guides if not page.first.startswith("For ")] == []


def test_a_line_is_the_first_sentence_without_links() -> None:
    assert read("how-to/troubleshoot").first == "For owners of a silent board: `servolink doctor` finds out why."
    assert "`servolink mcp`, a server of the Model Context Protocol, lets it" in read("how-to/language-models").first
    assert read("reference/commands/move").first == "Move servos to angles."
    for title, _, first in entries():
        assert not re.search(r"\]\(|```|<\w", title + first)
        assert len(first) < 210


@pytest.mark.skipif(not (SITE / "llms.txt").exists(), reason="the documentation is not built")
def test_the_site_has_it_with_what_it_leads_to() -> None:
    lines = (SITE / "llms.txt").read_text(encoding="utf-8").splitlines()
    leads = [match[2] for line in lines if (match := LINE.fullmatch(line))]
    assert len(leads) > 100
    assert not [name for name in leads if not Path(SITE / f"_sources/{name}.md.txt").exists()]
