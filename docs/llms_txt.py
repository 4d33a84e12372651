"""llms.txt of the site: its pages for programs that read, each with its title and first sentence.

The site has it with its other pages, and `python -m docs.llms_txt` prints it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from docs import command_pages
from docs.made_pages import text_of

FOLDER = Path(__file__).parent

_TOCTREE = re.compile(r"^```\{toctree\}\n(?P<options>(?::[^\n]*\n)*)\n?(?P<names>.*?)^```$", re.MULTILINE | re.DOTALL)
_CAPTION = re.compile(r"^:caption: (.+)$", re.MULTILINE)
_NO_PROSE = re.compile(r"```.*?^```$|<!--.*?-->|<(\w+)[^>]*>.*?</\1>|^[|!$:(<#][^\n]*$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"!?\[([^\]]*)\](?:\([^)]*\)|\[[^\]]*\])")
_SENTENCE = re.compile(r".*?(?:[.!?](?=\s+[^a-z\s]|\s*$)|。)", re.DOTALL)
_MOST = 200  # characters of a line about a page


class Page(NamedTuple):
    """Page of the documentation."""

    name: str
    """Path in this folder without its suffix, such as `how-to/install`."""
    title: str
    first: str
    """First sentence, without links."""


def text() -> str:
    """Return the file: what servolink is, then the pages, as the index sorts them, with addresses of their Markdown."""
    lines = ["# servolink", "", f"> {read('index').first}"]
    for caption, names in toctrees("index"):
        lines += ["", f"## {caption}", ""]
        for page in map(read, names):
            address = f"_sources/{page.name}.md.txt"
            lines.append(f"- [{page.title}]({address}){f': {page.first}' if page.first else ''}")
    return "\n".join([*lines, ""])


def toctrees(name: str) -> Iterator[tuple[str, list[str]]]:
    """Yield caption and pages of each list of pages on a page; a page is followed by those that it lists itself."""
    for found in _TOCTREE.finditer(_source(name)):
        caption = _CAPTION.search(found["options"])
        names: list[str] = []
        for line in found["names"].split():
            below = (PurePosixPath(name).parent / line).as_posix()
            names += [below, *(each for _, others in toctrees(below) for each in others)]
        yield caption[1] if caption else "", names


def read(name: str) -> Page:
    """Return the title and the first sentence of a page."""
    source = _source(name)
    title = next(line[2:] for line in source.splitlines() if line.startswith("# "))
    prose = _NO_PROSE.sub("", source.partition(f"# {title}\n")[2]).strip()
    paragraph = " ".join(_LINK.sub(r"\1", prose.partition("\n\n")[0]).split())
    found = _SENTENCE.match(paragraph)
    first = found[0] if found else re.sub(":$", ".", paragraph)
    return Page(name, title, first if len(first) <= _MOST else f"{first[:_MOST].rpartition(' ')[0]} ...")


def _source(name: str) -> str:
    """Return the Markdown of a page, made if it is, as in the site."""
    path = FOLDER / f"{name}.md"
    return _commands()[path.name] if path.parent == command_pages.SITE else text_of(path)


_commands = cache(command_pages.site_pages)


if __name__ == "__main__":
    print(text(), end="")  # noqa: T201 - what it is for
