"""Tests of a module are found by the name of the module, or by a line `Module: ...` at the head of a test file."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

from tests.syntax import modules_below, tree_of

ROOT = Path(__file__).parents[1]
TESTS = sorted((ROOT / "tests").rglob("test_*.py"))
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path
    for path in modules_below(ROOT / "servolink")
    if path.name not in {"__init__.py", "__main__.py"} and "node_modules" not in path.parts
}
LINE = re.compile(r"^Modules?: ([\w., \n]+)\.$", re.MULTILINE)


def part_of(path: Path) -> str:
    """Return the package of a module, or the folder of a test; empty at the top."""
    parts = path.relative_to(ROOT).parts
    return parts[1] if len(parts) > 2 else ""


@cache
def named_at_heads() -> dict[str, list[str]]:
    """Return the test files whose head names each module."""
    found = defaultdict(list)
    for path in TESTS:
        text = path.read_text(encoding="utf-8")
        for line in LINE.findall(ast.get_docstring(tree_of(path)) or "" if LINE.search(text) else ""):
            for module in line.split(","):
                found[module.strip()].append(path.name)
    return found


def test_each_module_has_a_test_file_with_its_name_or_a_line_at_the_head_of_one() -> None:
    by_name = {(part_of(path), path.stem.removeprefix("test_")) for path in TESTS}
    by_line = named_at_heads()
    missing = [
        name for name, path in MODULES.items() if (part_of(path), path.stem) not in by_name and name not in by_line
    ]
    assert not missing, f"write `Module: NAME.` at the end of the docstring of the file with its tests: {missing}"


def test_heads_name_modules_that_exist() -> None:
    assert named_at_heads().keys() - MODULES.keys() == set()
