"""The public reference: docs/reference/api/ as the code is, and `help(Board)` with arguments and errors."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import servolink
from docs.api_tables import PAGES, with_tables
from tests.tables import over


def test_every_public_name_is_on_a_page() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    missing = [name for name in servolink.__all__ if not re.search(rf"\b{re.escape(name)}\b", text)]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_tables_are_made_from_the_code(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert with_tables(text) == text, "run `python -m docs.api_tables`"


METHODS = [function for name, function in inspect.getmembers(servolink.Board, inspect.isfunction) if name[0] != "_"]


def listed(function: Callable[..., Any], section: str) -> list[str]:
    """Return the names in a section of a docstring."""
    text = inspect.getdoc(function) or ""
    _, found, rest = text.partition(f"\n\n{section}:\n")
    return re.findall(r"^    (\w+): \S", rest.partition("\n\n")[0], re.MULTILINE) if found else []


@over("function", [*METHODS, servolink.connect])
def test_help_lists_the_arguments_of_a_method_with_options(function: Callable[..., Any]) -> None:
    parameters = inspect.signature(function).parameters.values()
    names = [each.name for each in parameters if each.name != "self"]
    has_options = any(each.default is not each.empty for each in parameters if each.name not in {"servo_id", "folder"})
    described = listed(function, "Args")
    assert described in ([], names)
    assert described or not has_options, "methods with options have a section Args"


@over("function", [*METHODS, servolink.Board, servolink.connect])
def test_help_lists_errors_that_exist_and_several_in_a_section(function: Callable[..., Any]) -> None:
    named = listed(function, "Raises")
    assert [name for name in named if not issubclass(getattr(servolink, name), servolink.ServolinkError)] == []
    assert (
        named or len(re.findall(r"\bRaise \w+|, \w+(?:Error|Refused|Rejected|NotFound) ", function.__doc__ or "")) <= 1
    )
