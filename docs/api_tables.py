"""The tables in docs/reference/api/, made from signatures and docstrings.

`python -m docs.api_tables` writes them anew. Each stands between `<!-- members CLASS -->` or `<!-- names NAME ... -->`
and `<!-- end -->`, where names are those of `servolink` or full ones; the rest of a page is written by hand.
"""

from __future__ import annotations

import ast
import copy
import inspect
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from pydoc import locate
from typing import Any, TypeVar, get_args

from servolink.protocol import packet

FOLDER = Path(__file__).parent / "reference/api"
PAGES = sorted(FOLDER.glob("*.md"))

_BLOCK = re.compile(r"<!-- (members|names) ([^>]*) -->\n.*?<!-- end -->", re.DOTALL)
_HEAD = "| name | meaning |\n|---|---|\n"

_LONG = 90
"""Characters of a signature beyond which a row has the names of the parameters alone."""

Row = tuple[str, str]
F = TypeVar("F", bound=ast.FunctionDef | ast.AsyncFunctionDef)


def with_tables(page: str) -> str:
    """Return a page with each of its tables as the code is now."""
    return _BLOCK.sub(_block, page)


def _block(found: re.Match[str]) -> str:
    objects = [_find(name) for name in found[2].split()]
    rows = _members(objects[0]) if found[1] == "members" else map(_row, objects)
    unique = {re.split(r"[(:]", row[0])[0]: row for row in rows}  # a method that overrides another stands for it
    lines = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |\n" for row in unique.values()]
    return f"<!-- {found[1]} {found[2]} -->\n{_HEAD}{''.join(lines)}<!-- end -->"


def _find(name: str) -> Any:
    found = locate(name if name.startswith("servolink.") else f"servolink.{name}")
    if found is None:
        raise LookupError(f"docs/reference/api/ names {name}, which does not exist")
    return found


def _row(thing: Any) -> Row:
    """Return the row of a class or a function."""
    tree = _tree(thing)
    if not isinstance(tree, ast.ClassDef):
        return _function(tree)
    made = next((node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "__init__"), None)
    arguments = f"({_arguments(made)})" if made and not issubclass(thing, Exception) else ""
    if made and len(arguments) > _LONG:
        arguments = f"({_arguments(_untyped(made))})"
    return f"`{thing.__name__}{arguments}`", _summary(tree)


def _members(cls: type) -> Iterator[Row]:
    """Yield a row for each public attribute, property and method, in the order of the source, base classes first."""
    for base in reversed(cls.__mro__):
        if not base.__module__.startswith("servolink.") or base.__name__.startswith("_"):
            continue
        body = _tree(base).body
        for node, after in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.FunctionDef) and node.name == "__init__":
                yield from _set_at_first(node)
                continue
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                row = _function(node)
            elif isinstance(node, ast.AnnAssign) and "ClassVar" not in ast.unparse(node.annotation):
                row = _attribute(ast.unparse(node.target), node.annotation, after)
            else:
                continue
            if not row[0].startswith(("`_", "`await _")):
                yield row


def _set_at_first(made: ast.FunctionDef) -> Iterator[Row]:
    """Yield a row for each public attribute that `__init__` sets, with the meaning in the string after it."""
    for node, after in zip(made.body, made.body[1:], strict=False):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not isinstance(after, ast.Expr):
            continue
        name = ast.unparse(node.target if isinstance(node, ast.AnnAssign) else node.targets[0])
        if isinstance(after.value, ast.Constant) and re.fullmatch(r"self\.[a-z]\w*", name):
            value = getattr(node.value, "value", None)
            kind = ast.unparse(node.annotation) if isinstance(node, ast.AnnAssign) else type(value).__name__
            if kind != "NoneType":  # neither declared nor a constant
                yield f"`{name.removeprefix('self.')}: {kind}`", _first_sentence(str(after.value.value))


def _tree(thing: Any) -> Any:
    return ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]


def _attribute(name: str, annotation: ast.expr, after: ast.stmt | None) -> Row:
    """Return the row of an attribute, whose meaning is in the string after it or in its annotation."""
    meaning = ""
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) == "Annotated":
        annotation, *notes = annotation.slice.elts  # type: ignore[attr-defined]
        described = re.search(r"(?:description=|_about\()(['\"])(.*?)\1", " ".join(map(ast.unparse, notes)))
        meaning = described[2] if described else ""
    if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
        meaning = str(after.value.value)
    kind = re.sub(r"\w+", lambda word: _plain(word[0]), ast.unparse(annotation))
    return f"`{name}: {kind}`", _first_sentence(meaning)


def _plain(name: str) -> str:
    """Return `int` or `str` for a wire type such as `U8` or `Caption`, any other name as it is."""
    alias = getattr(packet, name, None)
    return str(get_args(alias)[0].__name__) if hasattr(alias, "__metadata__") else name


def _function(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Row:
    returns = ast.unparse(node.returns) if node.returns else "None"
    decorators = {ast.unparse(decorator) for decorator in node.decorator_list}
    if decorators & {"property", "cached_property", "functools.cached_property"}:
        return f"`{node.name}: {returns}`", _summary(node)
    awaited = re.fullmatch(r"Coroutine\[Any, Any, (.*)\]", returns)
    if awaited or (isinstance(node, ast.AsyncFunctionDef) and not returns.startswith("Async")):
        called, returns = "await ", awaited[1] if awaited else returns
    else:
        called = ""
    signature = f"{called}{node.name}({_arguments(node)}) -> {returns}"
    if len(signature) > _LONG:
        signature = f"{called}{node.name}({_arguments(_untyped(node))}) -> {returns}"
    return f"`{signature}`", _summary(node)


def _untyped(node: F) -> F:
    """Return a function with the names of its parameters alone, for a row that would be too long to read."""
    node = copy.deepcopy(node)
    for each in ast.walk(node.args):
        if isinstance(each, ast.arg):
            each.annotation = None
    node.args.defaults = []
    node.args.kw_defaults = [None] * len(node.args.kwonlyargs)
    return node


def _arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """Return the parameters as they stand in the source, without `self`."""
    for group in (node.args.posonlyargs, node.args.args):
        if group and group[0].arg in {"self", "cls"}:
            del group[0]
    return re.sub(r"(?<![=!<>])=(?!=)", " = ", ast.unparse(node.args))


def _summary(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> str:
    return _first_sentence(ast.get_docstring(node) or "")


def _first_sentence(text: str) -> str:
    """Return the first sentence of a docstring, which may go over several lines."""
    paragraph = " ".join(inspect.cleandoc(text).partition("\n\n")[0].split())
    return re.split(r"(?<=\.) (?=[A-Z`])", paragraph, maxsplit=1)[0]


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(with_tables(page.read_text(encoding="utf-8")), encoding="utf-8")
