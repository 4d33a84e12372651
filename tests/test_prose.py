"""Docstrings, comments, messages and pages are plain English, by a list of idioms and by the measure of `prose.py`.

The measure holds for each package.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.made_pages import MADE, text_of
from tests.prose import LEAST_WORDS, Figures, figures, read, sources
from tests.syntax import modules_below, tree_of

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
PROJECT = ROOT / "servolink"
MODULES = modules_below(PROJECT)

IDIOMS = {
    r"^Tell whether\b": "Return whether",
    r"(?<!there )\bis no (?!longer\b|more\b|\w+er\b)": "must be, is not a",
    r"\b(is|are) none of\b": "must be one of",
    r"\btakes? note\b": "record",
    r"\blet go of\b": "release",
    r"\bto begin anew\b": "to start over",
    r"\bgo(es)? on with\b": "continue with",
    r"^(Whoever|Whatever) ": "name the person or the thing",
    r"pip install .?servolink\[": "pip install '.[EXTRA]', in a copy of the repository: servolink is on no index",
}
"""Idioms, as regular expressions, and what to write instead."""
_ANYWHERE = re.compile("|".join(idiom.removeprefix("^") for idiom in IDIOMS), re.IGNORECASE)
_BETWEEN_LITERALS = re.compile(r"[\"']\s+[rf]?[\"']")
"""End of a literal and begin of the next one, which Python joins."""

MOST_RIDDLES = 2.0
"""Riddles among the lines of a package, percent."""
MOST_PRONOUNS = 5.3
"""Pronouns per 100 words of a package."""
MOST_IN_PAGES = {"design": (3.0, 7.5), "how-to": (5.0, 8.5), "reference": (5.5, 7.0)}
"""Riddles among the sentences of the pages in a folder, percent, and pronouns per 100 words.

Tables and headings are not measured.
"""
REMARKS = {
    "boards": (140, 11),
    "cli": (85, 9),
    "client": (164, 13),
    "connection": (191, 18),
    "control": (181, 28),
    "doctor": (122, 16),
    "fleet": (144, 10),
    "hub": (157, 17),
    "motion": (172, 11),
    "project": (145, 7),
    "protocol": (179, 10),
    "recorder": (129, 20),
    "servolink": (154, 12),
    "studio": (167, 17),
    "studio/web": (99, 8),
    "sync": (177, 34),
    "transports": (164, 16),
    "virtual": (167, 18),
}
"""Fewest measured remarks and most short ones per 1,000 lines of code, as before the prose was rewritten; doors
and tables of times are lists, and not counted.

Remarks are docstrings and comments. Neither deleting nor shortening a riddle to a few words improves a figure.
"""
REMARKS_ELSEWHERE = (141, 14)
_TABLES = {"__init__", "times"}
"""Modules that are tables of names, or of times."""


def packages() -> dict[str, list[Path]]:
    """Return the source files of each package; `servolink` has the modules outside packages, `studio/web` the page."""
    web = PROJECT / "studio" / "web"
    code = [file for file in sources(web) if file.parent.name != "texts" or file.stem == "text"]  # no tables of texts
    found = {"servolink": sorted(PROJECT.glob("*.py")), "studio/web": code}
    for folder in PROJECT.iterdir():
        if files := [
            file for file in sources(folder) if folder.is_dir() and web not in file.parents and file.stem not in _TABLES
        ]:
            found[folder.name] = files
    return found


PACKAGES = packages()


def aims_of(package: str) -> Figures:
    """Return the measure for a package."""
    return Figures(MOST_RIDDLES, MOST_PRONOUNS, *REMARKS.get(package, REMARKS_ELSEWHERE))


def prose_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield each docstring, message and comment of a module, or each line of a page, with its line number."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        yield from enumerate(text.splitlines(), 1)
        return
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string.lstrip("# ")


def may_have_idioms(path: Path) -> bool:
    """Return whether an idiom is anywhere in a file, as prose or as code: a search far quicker than a syntax tree."""
    in_one_piece = _BETWEEN_LITERALS.sub("", path.read_text(encoding="utf-8"))
    return bool(_ANYWHERE.search(in_one_piece))


def test_prose_is_plain() -> None:
    idioms = [(re.compile(idiom, re.IGNORECASE | re.MULTILINE), better) for idiom, better in IDIOMS.items()]
    found = [
        f"{path.relative_to(ROOT)}:{line}: {match[0]!r}; write {better!r} instead"
        for path in filter(may_have_idioms, (*MODULES, *PAGES))
        for line, text in prose_of(path)
        for wrong, better in idioms
        for match in wrong.finditer(text)
    ]
    assert not found, "\n".join(found)


def test_idioms_are_found_across_literals(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    file.write_text('raise ValueError("a port is "\n    f"no address")\n', encoding="utf-8")
    assert may_have_idioms(file)
    file.write_text('raise ValueError("a port must be a number")\n', encoding="utf-8")
    assert not may_have_idioms(file)


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_each_package_holds_the_measure(package: str) -> None:
    found, aims = figures(PACKAGES[package]), aims_of(package)
    worse = [
        f"{name} {value:.1f}, bound {bound}"
        for name, value, bound in zip(Figures._fields, found, aims, strict=True)
        if (value < bound if name == "lines" else value > bound)
    ]
    assert not worse, f"{package}: {worse}; `python -m tests.prose servolink/{package}` prints the worst lines"


@pytest.mark.parametrize("folder", MOST_IN_PAGES)
def test_pages_hold_the_measure(folder: str, tmp_path: Path) -> None:
    for page in {*(ROOT / "docs" / folder).glob("*.md"), *MADE}:
        if page.parent.name == folder and page.suffix == ".md":
            (tmp_path / page.name).write_text(text_of(page), encoding="utf-8")
    found = figures(tmp_path.glob("*.md"))
    most_riddles, most_pronouns = MOST_IN_PAGES[folder]
    worst = f"`python -m tests.prose docs/{folder}/PAGE.md` prints the worst sentences of a page"
    assert found.riddles <= most_riddles, worst
    assert found.pronouns <= most_pronouns, worst


def test_measure_reads_sentences_of_a_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# What it is that they are to have\n\n"
        "| what | it is that they are to have |\n|---|---|\n\n"
        "A hub sends `one of these` to\n[the board](which.md). It is what they have.\n\n"
        "```text\nthis is not what it is\n```\n",
        encoding="utf-8",
    )
    assert [line.text for line in read(page)[0]] == ["A hub sends N to the board.", "It is what they have."]
    found = figures([page])
    assert (found.riddles, found.pronouns) == pytest.approx((50, 100 * 3 / 12))


def test_measure_reads_docstrings_comments_and_messages_of_a_module(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    file.write_text(
        '"""What it is that they are to have."""\n\n'
        "LIMIT = 3  # seconds\n"
        '"""Longest pause between two attempts.\n\nNot measured: a later line."""\n'
        "# noqa: this comment is for a tool\n"
        "def check(name: str) -> None:\n"
        '    raise ValueError(f"{name} must not be one of them")\n',
        encoding="utf-8",
    )
    lines, code = read(file)
    assert code == 3
    assert [line.text for line in lines if line.is_message] == ["N must not be one of them"]
    assert {line.text for line in lines if not line.is_message} == {
        "What it is that they are to have.",
        "seconds",
        "Longest pause between two attempts.",
    }
    found = figures([file])
    assert found.riddles == pytest.approx(100 * 2 / 3)
    assert found.pronouns == pytest.approx(100 * 6 / 20)
    assert (found.lines, found.short) == pytest.approx((2000 / 3, 1000 / 3))


def test_measure_reads_comments_of_a_script(tmp_path: Path) -> None:
    file = tmp_path / "script.js"
    file.write_text(
        "// Beats that keep a motion lease alive.\n\n"
        'const hub = "https://example.org // of it";\n'
        "/**\n * Send one beat each 50 ms. Not on a new line.\n * Not measured: a later line.\n"
        " * @param {Link} link it is not read\n */\n"
        "const LATE = 1; // seconds\n"
        "/** @type {Pose | null} */\n",
        encoding="utf-8",
    )
    lines, code = read(file)
    assert code == 2
    assert [line.text for line in lines if len(line.words) >= LEAST_WORDS] == [
        "Beats that keep a motion lease alive.",
        "Send one beat each 50 ms. Not on a new line.",
    ]
