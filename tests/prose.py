"""Measure of prose: share of function words and of pronouns in comments, first lines of docstrings, and messages.

`python -m tests.prose servolink/hub` prints the figures of a file or folder, and its worst lines.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from tests.syntax import tree_of

LEAST_WORDS = 5
"""Words in the shortest line that is measured."""
RIDDLE = 0.6
"""Least share of function words in a riddle, 0 to 1: a line that names next to nothing."""
_WORDS = (
    "after all also and another any anybody are as at be been before both but by came can come comes did do does done "
    "each else everybody for from goes gone had has have here if in is it its left may more most must no nobody none "
    "not nothing now of on one ones only or other others out said says so somebody something than that them then there "
    "these they this those to too until up was were what whatever when where which while who whoever whom whose "
    "with"
)
FUNCTION_WORDS = frozenset(_WORDS.split())
PRONOUNS = frozenset({"it", "its", "one", "that", "them", "they", "this", "those", "what", "which", "who"})

_WORD = re.compile(r"(?<![\w./=-])[A-Za-z][A-Za-z'-]*(?![\w=/]|\.\w)")
"""A word of English: not an option, path, address or dotted name."""
_DIRECTIVE = re.compile(r"#\s*(noqa|type:|pragma|!)")
_SCRIPT_COMMENT = re.compile(r"(?:^|(?<=\s))//\s(?P<line>.+)|/\*\*?(?P<block>[\s\S]*?)\*/", re.MULTILINE)
_FENCED = re.compile(r"```.*?```", re.DOTALL)
_CODE = re.compile(r"`[^`]*`")
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_SENTENCE_END = re.compile(r"(?<=[.:;?!])\s+")
_SCRIPT_TAG = re.compile(r"@\w+")
_WORST = 40


class Line(NamedTuple):
    """Line of prose in a source file."""

    place: str
    text: str
    is_message: bool

    @property
    def words(self) -> list[str]:
        """Words of the line, in lower case."""
        return [word.lower() for word in _WORD.findall(self.text)]

    @property
    def share(self) -> float:
        """Share of function words, 0 to 1."""
        words = self.words
        return sum(word in FUNCTION_WORDS for word in words) / len(words)

    @property
    def pronouns(self) -> int:
        """Number of pronouns."""
        return sum(word in PRONOUNS for word in self.words)


class Figures(NamedTuple):
    """Figures of the prose in some files."""

    riddles: float
    """Riddles among the lines, percent."""
    pronouns: float
    """Pronouns per 100 words."""
    lines: float
    """Measured docstrings and comments per 1,000 lines of code."""
    short: float
    """Docstrings and comments of too few words to be measured, per 1,000 lines of code."""


def read(path: Path) -> tuple[list[Line], int]:
    """Return the prose of a file, equal lines once, and the number of its lines of code; of a page, the sentences."""
    lines, code = _READERS[path.suffix](path)
    distinct = {(line.text, line.is_message): line for line in lines if line.words}
    return list(distinct.values()), code


def _read_module(path: Path) -> tuple[list[Line], int]:
    tree = tree_of(path)
    found: list[Line] = []
    inner: set[ast.AST] = set()
    text_rows: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            first = node.value.value.strip().partition("\n")[0]
            found.append(Line(f"{path}:{node.lineno}", first, is_message=False))
            inner.add(node.value)
            text_rows.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        elif isinstance(node, ast.JoinedStr):
            inner.update(node.values)
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "N" for part in node.values)
            found.extend(_messages(path, node.lineno, text))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in inner:
            found.extend(_messages(path, node.lineno, node.value))
    code_rows: set[int] = set()
    silent = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
        if token.type == tokenize.COMMENT:
            if not _DIRECTIVE.match(token.string):
                found.append(Line(f"{path}:{token.start[0]}", token.string.lstrip("# "), is_message=False))
        elif token.type not in silent:
            code_rows.update(range(token.start[0], token.end[0] + 1))
    return found, len(code_rows - text_rows)


def _messages(path: Path, row: int, text: str) -> Iterator[Line]:
    """Yield the lines of a text that is measured, a value in it as a word `N`."""
    for line in text.splitlines():
        message = Line(f"{path}:{row}", line.strip(), is_message=True)
        if len(message.words) >= LEAST_WORDS:
            yield message


def _read_page(path: Path) -> tuple[list[Line], int]:
    found: list[Line] = []
    for paragraph in re.split(r"\n\s*\n", _FENCED.sub("", path.read_text(encoding="utf-8"))):
        if not paragraph.startswith(("|", "#", "<", ":::")):
            text = " ".join(_LINK.sub(r"\1", _CODE.sub("N", paragraph)).split())
            found.extend(Line(str(path), sentence, is_message=True) for sentence in _SENTENCE_END.split(text))
    return [line for line in found if len(line.words) >= LEAST_WORDS], 0


def _read_script(path: Path) -> tuple[list[Line], int]:
    source = path.read_text(encoding="utf-8")
    found: list[Line] = []
    for match in _SCRIPT_COMMENT.finditer(source):
        place = f"{path}:{source.count(chr(10), 0, match.start()) + 1}"
        rows = [match["line"]] if match["line"] else match["block"].splitlines()
        texts = (_SCRIPT_TAG.split(row)[0].strip(" */") for row in rows)
        found.extend(Line(place, text, is_message=False) for text in [next(filter(None, texts), "")] if text)
    rest = _SCRIPT_COMMENT.sub("", source)
    return found, sum(bool(row.strip()) for row in rest.splitlines())


_READERS = {".py": _read_module, ".js": _read_script, ".md": _read_page}


def figures(paths: Iterable[Path]) -> Figures:
    """Return the figures of files of one package."""
    found, code = [], 0
    for path in paths:
        lines, rows = read(path)
        found += lines
        code += rows
    measured = [line for line in found if len(line.words) >= LEAST_WORDS]
    words = sum(len(line.words) for line in measured)
    remarks = sum(not line.is_message for line in measured)
    return Figures(
        riddles=100 * sum(line.share >= RIDDLE for line in measured) / (len(measured) or 1),
        pronouns=100 * sum(line.pronouns for line in measured) / (words or 1),
        lines=1000 * remarks / (code or 1),
        short=1000 * (sum(not line.is_message for line in found) - remarks) / (code or 1),
    )


def sources(place: Path) -> list[Path]:
    """Return the Python and JavaScript files in a folder, except those of other projects, or the file itself."""
    files = [place] if place.is_file() else sorted([*place.rglob("*.py"), *place.rglob("*.js")])
    return [file for file in files if not {"vendor", "node_modules"} & set(file.parts)]


def main(places: list[str]) -> None:
    """Print the figures of files or folders, and the lines with the most function words and pronouns."""
    for place in places:
        files = sources(Path(place))
        print(place, *(f"{name} {value:.1f}" for name, value in figures(files)._asdict().items()))
        lines = [line for file in files for line in read(file)[0] if len(line.words) >= LEAST_WORDS]
        for line in sorted(lines, key=lambda line: line.share + line.pronouns / 10, reverse=True)[:_WORST]:
            print(f"  {line.share:.2f} {line.pronouns} {line.place}: {line.text}")


if __name__ == "__main__":
    main(sys.argv[1:])
