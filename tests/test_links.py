"""Links of README.md and docs/ lead somewhere in the repository, or to a page of the reference that the site has.

From the start page they lead a stranger to answers.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.command_pages import SITE
from docs.made_pages import MADE, text_of
from tests.tables import over

ROOT = Path(__file__).parents[1]
WRITTEN = {path for path in (ROOT / "docs").rglob("*.md") if "_" not in path.parent.name and path.parent != SITE}
PAGES = [ROOT / "README.md", *sorted(WRITTEN | {path for path in MADE if path.suffix == ".md"})]

START = ROOT / "docs/index.md"
ANSWERS = [
    ("my board is silent", ["When a board does not respond"], "how-to/troubleshoot", "When a board does not respond"),
    ("two programs at once", ["Share a board"], "how-to/share-a-board", "Share a board: two programs at once"),
    ("a class of 20", ["A class of 20"], "how-to/fleet-classroom", "Set up the broker"),
    ("my own transport", ["My own transport"], "how-to/write-a-transport", "Be found"),
    ("test my program", ["Test my program"], "how-to/test-programs", "A first test"),
    ("restore yesterday", ["restore yesterday"], "how-to/save-and-restore", "Undo it"),
    ("without installation", ["without installation"], "how-to/without-installation", "Get the folder"),
    ("a robot that falls", ["Know whether the robot falls"], "how-to/twin", "Ask for a forecast"),
    ("from ROS 2", ["From ROS 2"], "how-to/ros2", "Use the robot from ROS 2"),
    ("button events", ["button events"], "how-to/button-events", "React to buttons, and press them by keyboard"),
    ("Windows: no port shown", ["no port shown on Windows"], "how-to/connect", "Windows: no port is shown"),
    ("how fast is it", ["How fast it is", "roundtrip"], "benchmarks", "A request and its response"),
]
"""Questions of strangers: links to follow from the start page, in order, and page and heading of the answer."""
SOURCES = [
    path.relative_to(ROOT).as_posix()
    for folder in ("servolink", "tests", "benchmarks", "docs")
    for suffix in ("py", "js")
    for path in (ROOT / folder).rglob(f"*.{suffix}")
]
MOST_CLICKS = 3
MOST_LINES = 200
"""Lines of a page in docs/design."""

_LINK = re.compile(r"\[([^\]\n]*(?:\n[^\]\n]+)?)\]\(([^)\s]+)\)")


@over("page", PAGES)
def test_links_have_a_text_and_lead_somewhere(page: Path) -> None:
    for text, target in links(page):
        assert text, target
        path, _, heading = target.partition("#")
        if "://" in target:
            continue
        aim = page.parent / path if path else page
        assert aim.exists() or aim.resolve() in MADE, target
        assert not heading or heading in anchors(aim), target


@pytest.mark.parametrize(("question", "clicks", "page", "heading"), ANSWERS, ids=[row[0] for row in ANSWERS])
def test_a_stranger_reaches_the_answer(question: str, clicks: list[str], page: str, heading: str) -> None:
    assert len(clicks) <= MOST_CLICKS, question
    at, anchor = START, ""
    for text in clicks:
        target = {" ".join(text.split()): target for text, target in links(at)}[text]
        path, _, anchor = target.partition("#")
        at = (at.parent / path).resolve() if path else at
    assert at == ROOT / f"docs/{page}.md", question
    wanted = _anchor(heading)
    assert wanted in anchors(at), question
    assert anchor in {"", wanted}, "the link leads to the heading, or to the page that has it"


@over("page", sorted((ROOT / "docs/design").glob("*.md")))
def test_a_page_on_the_design_is_short_and_names_files_that_there_are(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.count("\n") <= MOST_LINES
    for name in re.findall(r"`([\w./-]*\w\.(?:py|js))`", text):
        assert any(f"/{path}".endswith(f"/{name}") for path in SOURCES), name


def links(page: Path) -> list[tuple[str, str]]:
    """Return text and target of each link on a page, without what is in blocks of code."""
    text = re.sub(r"^```.*?^```$", "", text_of(page.resolve()), flags=re.MULTILINE | re.DOTALL)
    return _LINK.findall(text)


def anchors(page: Path) -> set[str]:
    """Return the anchors that a repository's web page makes of the headings of `page`; a second one ends in -1."""
    headings = re.findall(r"^#+ (.+)$", text_of(page.resolve()), flags=re.MULTILINE)
    plain = [_anchor(heading) for heading in headings]
    return {f"{name}-{plain[:at].count(name)}" if name in plain[:at] else name for at, name in enumerate(plain)}


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")
