"""Pages of the documentation that the studio serves beside itself: a classroom may have no network."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import pairwise
from pathlib import Path
from posixpath import dirname, normpath

from markdown_it import MarkdownIt
from markdown_it.token import Token

FOLDERS = ("how-to", "tutorial")
"""Folders of the documentation for owners and teachers; a link to any other page shows its words only."""
_CHECKOUT = Path(__file__).parents[2] / "docs"
_NOTES = ("{note}", "{tip}", "{warning}")
_UNUSUAL = re.compile(r"[^\w -]")
_PAGE = """<!doctype html>
<html lang="{language}">
  <head>
    <meta charset="utf-8" />
    <meta name="viewport" content="width=device-width, initial-scale=1" />
    <title>{title} - servolink</title>
    <link rel="icon" href="/icon.svg" type="image/svg+xml" />
    <link rel="stylesheet" href="/css/docs.css" />
  </head>
  <body>
    <main>
{body}    </main>
  </body>
</html>
"""


@cache
def page_names() -> frozenset[str]:
    """Return the pages that there are, such as `how-to/studio`."""
    return frozenset(f"{folder}/{name}" for folder in FOLDERS for name in _names(_root() / folder))


@cache
def docs_page(name: str) -> bytes:
    """Return a page, one of `page_names`, as HTML."""
    tokens = _reader().parse((_root() / f"{name}.md").read_text(encoding="utf-8"))
    _change(tokens, name)
    body = _reader().renderer.render(tokens, _reader().options, {})
    language = "zh-Hant" if name.endswith("zh-hant") else "zh-Hans" if name.endswith("zh-hans") else "en"
    title = next((after.content for token, after in pairwise(tokens) if token.tag == "h1"), name)
    return _PAGE.format(language=language, title=escape(title), body=body).encode()


def _root() -> Traversable:
    """Return the folder of the documentation: in the package if it is installed, or else in the checkout."""
    packed = files("servolink.studio") / "docs"
    return packed if packed.is_dir() else _CHECKOUT


def _names(folder: Traversable) -> Iterator[str]:
    if folder.is_dir():
        yield from (entry.name[:-3] for entry in folder.iterdir() if entry.name.endswith(".md"))


@cache
def _reader() -> MarkdownIt:
    return MarkdownIt("commonmark", {"html": False}).enable("table")


def _change(tokens: Sequence[Token], name: str) -> None:
    """Let headings be targets of links, and links lead to what is served; show notes, and no pictures."""
    for token, after in zip(tokens, [*tokens[1:], Token("", "", 0)], strict=True):
        if token.type == "heading_open":
            token.attrSet("id", _UNUSUAL.sub("", after.content.lower()).replace(" ", "-"))
        elif token.type == "fence" and token.info.startswith("{"):
            is_note = token.info.split()[0] in _NOTES
            token.type, token.content = "html_block", _quoted(token.content, name) if is_note else ""
        _change_inline(token.children or (), name)


def _quoted(text: str, name: str) -> str:
    tokens = _reader().parse(text)
    _change(tokens, name)
    return f"<blockquote>{_reader().renderer.render(tokens, _reader().options, {})}</blockquote>\n"


def _change_inline(tokens: Sequence[Token], name: str) -> None:
    is_left = False  # whether the link around the present token is left out
    for token in tokens:
        if token.type == "image":
            token.type, token.content = "text", f"({token.content})"
        elif token.type == "link_open":
            address = _served(str(token.attrGet("href")), name)
            is_left = not address
            token.attrs = {"href": address} if address else {}
            if "://" in address:
                token.attrs |= {"rel": "noopener noreferrer"}
        if is_left and token.type in {"link_open", "link_close"}:
            token.tag = "span"


def _served(address: str, name: str) -> str:
    """Return where a link leads that page `name` has; empty if the studio does not serve it."""
    if address.startswith(("https://", "#")):
        return address
    path, _, heading = address.partition("#")
    page = normpath(f"{dirname(name)}/{path}").removesuffix(".md")
    return f"/docs/{page}{heading and f'#{heading}'}" if page in page_names() else ""
