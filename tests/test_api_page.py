"""docs/reference/api.md names everything that is public."""

from __future__ import annotations

import re

import servolink
from docs.api_tables import PAGE


def test_every_public_name_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    missing = [name for name in servolink.__all__ if not re.search(rf"\b{re.escape(name)}\b", page)]
    assert not missing
