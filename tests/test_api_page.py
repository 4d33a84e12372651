"""docs/reference/api.md names everything that is public, and describes it as the code does."""

from __future__ import annotations

import re

import servolink
from docs.api_tables import PAGE, with_tables


def test_every_public_name_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    missing = [name for name in servolink.__all__ if not re.search(rf"\b{re.escape(name)}\b", page)]
    assert not missing


def test_the_tables_are_made_from_the_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert with_tables(page) == page, "run `python -m docs.api_tables`"
