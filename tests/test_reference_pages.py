"""Pages of the reference that are written by hand name all that the code has."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from tests.syntax import tree_of

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs/reference"
OPTION = re.compile(r"\baddress\.(?:choice|flag|integer|number|text)\(\"(\w+)\"")


def missing(page: str, names: set[str]) -> set[str]:
    """Return the names that `page` lacks as code."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    return {name for name in names if f"`{name}`" not in text}


def test_each_finding_of_doctor_is_on_the_page() -> None:
    checks = {
        str(constant.value)
        for path in (ROOT / "servolink/doctor").glob("*.py")
        for call in ast.walk(tree_of(path))
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "Finding"
        for constant in ast.walk(call.args[0])
        if isinstance(constant, ast.Constant)
    }
    assert len(checks) > 20
    assert missing("doctor.md", checks) == set()


def test_each_option_of_an_address_is_on_a_page() -> None:
    options = {
        name
        for path in (ROOT / "servolink").rglob("*.py")
        if path.parent.name in {"transports", "control", "connection", "recorder"} and path.stem != "line_faults"
        for name in OPTION.findall(path.read_text(encoding="utf-8"))
    }
    assert {"baudrate", "role", "patience", "speed"} <= options
    assert missing("addresses.md", options) == set()
    virtual = OPTION.findall((ROOT / "servolink/virtual/transport.py").read_text(encoding="utf-8"))
    assert missing("virtual-board.md", set(virtual) - {"odd", "byte_order"}) == set()
