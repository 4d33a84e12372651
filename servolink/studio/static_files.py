"""The files of the page, read once: nothing else in the package can be asked for."""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable

import msgspec
from msgspec import Struct

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".woff2": "font/woff2",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
"""Content types by the end of a name. Files of other kinds, such as type declarations, are not served."""
_NOT_SERVED = {"tsconfig.json", "vendor.json"}
_LIBRARIES = "/vendor/"
_COMMENT = re.compile(rb"^[ \t]*//.*$|/\*(?:(?!\*/)[\s\S])*\*/", re.MULTILINE)
"""Comments, an eighth of all bytes for a browser; a comment behind code only if it holds types."""
_INDENTATION = re.compile(rb"^[ \t]+", re.MULTILINE)
"""Indentation, without meaning in style sheets and in texts of our modules: htm skips leading spaces."""


class PageFile(Struct, frozen=True):
    """File of the page, ready to send."""

    content: bytes
    content_type: str
    tag: str
    """Tag that changes with the content."""


@cache
def page_files() -> dict[str, PageFile]:
    """Return the files of the page by path, such as `/figure/stage.js`; `/` is the page."""
    found = dict(_files(files("servolink.studio") / "web", ""))
    found["/"] = found["/index.html"]
    return found


def _files(folder: Traversable, path: str) -> list[tuple[str, PageFile]]:
    found: list[tuple[str, PageFile]] = []
    for entry in folder.iterdir():
        name, end = f"{path}/{entry.name}", entry.name[entry.name.rfind(".") :]
        if entry.is_dir():
            found += _files(entry, name)
        elif end in _TYPES and entry.name not in _NOT_SERVED:
            content = entry.read_bytes()
            if end in {".js", ".css"} and not name.startswith(_LIBRARIES):
                content = _INDENTATION.sub(b"", _COMMENT.sub(_same_lines, content))
            elif end == ".json":
                content = msgspec.json.format(content, indent=-1)
            found.append((name, PageFile(content, _TYPES[end], sha256(content).hexdigest()[:16])))
    return found


def _same_lines(comment: re.Match[bytes]) -> bytes:
    """Return as many line breaks as a comment has, so that errors in the browser name the lines of the source."""
    return b"\n" * comment[0].count(b"\n")
