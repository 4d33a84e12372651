"""Docstrings, messages and pages are plain English: some idioms are not allowed back."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from tests.syntax import tree_of

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
MODULES = sorted((ROOT / "servolink").rglob("*.py"))

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


def test_prose_is_plain() -> None:
    idioms = [(re.compile(idiom, re.IGNORECASE | re.MULTILINE), better) for idiom, better in IDIOMS.items()]
    found = [
        f"{path.relative_to(ROOT)}:{line}: {match[0]!r}; write {better!r} instead"
        for path in (*MODULES, *PAGES)
        for line, text in prose_of(path)
        for wrong, better in idioms
        for match in wrong.finditer(text)
    ]
    assert not found, "\n".join(found)
