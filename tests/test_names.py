"""One meaning for one name: of classes, of files, and of the words in the glossary."""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

from tests.syntax import modules_below, tree_of

PACKAGE = Path(__file__).parents[1] / "servolink"
MODULES = modules_below(PACKAGE)
CLASS = re.compile(r"^\s*class (\w+)", re.MULTILINE)

MOST_SHARED = 7
"""Most names of classes and files together that may stand for two things."""
SHARED = {
    "Board": "the client with async and without: what a program knows of one is true of the other",
    "ButtonEvents": "likewise: the events with async and without",
    "Recorder": "likewise: a recording with async and without",
    "ServoReadings": "likewise: the readings with async and without",
    "ServoStream": "likewise: the set-points with async and without",
    "Command": "the word of the protocol's document, and of the shell",
    "board.py": "the board of its package: with async, without, and virtual",
}
"""Names that stand for two things, with the reason."""


def shared_names() -> set[str]:
    """Return the names of files and of classes, private and nested ones too, that occur more than once."""
    places = defaultdict(list)
    for module in MODULES:
        if module.name != "__init__.py":
            places[module.name].append(module)
        for name in CLASS.findall(module.read_text(encoding="utf-8")):
            places[name].append(module)
    return {name for name, found in places.items() if len(found) > 1}


def test_each_class_and_each_file_has_a_name_of_its_own_or_a_reason_to_share_one() -> None:
    assert shared_names() == set(SHARED)


def test_few_names_are_shared() -> None:
    assert len(SHARED) <= MOST_SHARED


MOST_ALIKE = 2
"""Most names of a private class that are those of another class but for the underscore."""


def test_few_private_classes_are_called_as_another_class_is() -> None:
    names = [name for module in MODULES for name in CLASS.findall(module.read_text(encoding="utf-8"))]
    alike = {name for name, times in Counter(name.lstrip("_") for name in names).items() if times > 1}
    assert len(alike - set(SHARED)) <= MOST_ALIKE


def test_no_two_modules_begin_with_the_same_sentence() -> None:
    places = defaultdict(list)
    for module in MODULES:
        first = " ".join((ast.get_docstring(tree_of(module)) or "").partition("\n\n")[0].split())
        places[first.partition(". ")[0].rstrip(".").lower()].append(str(module.relative_to(PACKAGE)))
    assert "" not in places, "a module without a docstring"
    assert [names for names in places.values() if len(names) > 1] == []


GLOSSARY = PACKAGE.parent / "docs/reference/glossary.md"
WORDS = {
    *("hold", "fence", "word", "wire", "line", "lane", "slot", "exclusive use", "lease", "ticket", "gate", "frame"),
    *("packet", "connection", "transport", "record", "journal"),
}
"""Words of the glossary that names in the code are made of."""
NEVER = {"alone": "exclusive", "desk": "handler"}
"""Words that no name has, and the word to use."""
ONLY_IN = {
    "journal": ("project/", "doctor/learn_trial.py"),
    "fence": ("connection/", "doctor/learn_line.py", "doctor/learn_writes.py"),
    "lane": ("connection/",),
}
"""Words that names have only in some parts, where they have their meaning."""
HELD_IN_HUB = {
    "MOST_HELD": "bytes held back for a program that does not read",
    "_held": "likewise",
    "board_hold": "method of the control interface, whose name is a promise",
}
"""Names in the hub with hold or held; exclusive use of the board is called exclusive use."""


@cache
def names_in(module: Path) -> tuple[str, ...]:
    """Return the names of the classes, functions, parameters, variables and attributes that a module defines."""
    return tuple(name for node in ast.walk(tree_of(module)) if (name := _defined_by(node)))


def _defined_by(node: ast.AST) -> str:
    match node:
        case ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef():
            return node.name
        case ast.arg():
            return node.arg
        case ast.Name(ctx=ast.Store()):
            return node.id
        case ast.Attribute(ctx=ast.Store()):
            return node.attr
    return ""


def words_of(name: str) -> set[str]:
    """Return the words of a name in any style, in lower case."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", name)}


def test_the_glossary_has_each_word_once() -> None:
    heads = re.findall(r"^- \*\*(.+?)\*\*:", GLOSSARY.read_text(encoding="utf-8"), re.MULTILINE)
    found = Counter(word for head in heads for word in head.split(", "))
    assert {word for word, count in found.items() if count > 1} == set()
    assert found.keys() >= WORDS


def test_names_have_no_word_that_another_one_says_better() -> None:
    found = {
        f"{module.relative_to(PACKAGE).as_posix()}: {name}: {NEVER[word]}"
        for module in MODULES
        for name in names_in(module)
        for word in words_of(name) & NEVER.keys()
    }
    assert found == set()


def test_words_with_one_meaning_are_used_where_they_have_it() -> None:
    found = {
        f"{place}: {name}"
        for module in MODULES
        for place in [module.relative_to(PACKAGE).as_posix()]
        for name in names_in(module)
        for word in words_of(name) & ONLY_IN.keys()
        if not place.startswith(ONLY_IN[word])
    }
    assert found == set()


def test_hold_means_a_servo_in_the_hub_too() -> None:
    found = {
        node.name if isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)) else node.attr
        for module in (PACKAGE / "hub").rglob("*.py")
        for node in ast.walk(tree_of(module))
        if isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        or (isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store))
    }
    assert {name for name in found if words_of(name) & {"hold", "held"}} <= HELD_IN_HUB.keys()
