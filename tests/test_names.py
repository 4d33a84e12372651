"""One meaning for one name: classes and files have names of their own, or a reason to share one."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

from tests.syntax import tree_of

PACKAGE = Path(__file__).parents[1] / "servolink"
MODULES = sorted(PACKAGE.rglob("*.py"))

MOST_SHARED = 12
"""Most names of classes and files together that may stand for two things."""
SHARED = {
    "Board": "the client with async and without: what a program knows of one is true of the other",
    "ButtonEvents": "likewise: the events with async and without",
    "Recorder": "likewise: a recording with async and without",
    "ServoReadings": "likewise: the readings with async and without",
    "Command": "the word of the protocol's document, of the schema of a fleet, and of the shell",
    "Result": "the word of the protocol's document, and of the schema of a fleet",
    "ServoState": "the packet of the document, and the message of a recording, whose schema has this name",
    "Step": "the word of the protocol's document, and of the schema of a fleet",
    "board.py": "the board of its package: with async, without, and virtual",
}
"""Names that stand for two things, with the reason."""


def shared_names() -> set[str]:
    """Return the names of files and of classes, private and nested ones too, that occur more than once."""
    places = defaultdict(list)
    for module in MODULES:
        if module.name != "__init__.py":
            places[module.name].append(module)
        for node in ast.walk(tree_of(module)):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module)
    return {name for name, found in places.items() if len(found) > 1}


def test_each_class_and_each_file_has_a_name_of_its_own_or_a_reason_to_share_one() -> None:
    assert shared_names() == set(SHARED)


def test_few_names_are_shared() -> None:
    assert len(SHARED) <= MOST_SHARED
