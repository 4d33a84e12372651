"""The page and the JSON Schema of the topics."""

from __future__ import annotations

from docs.fleet_reference import PAGE, SCHEMA, fleet_reference, schema_text


def test_the_page_and_the_schema_are_made_from_the_declarations() -> None:
    assert PAGE.read_text(encoding="utf-8") == fleet_reference(), "run `python -m docs.fleet_reference`"
    assert SCHEMA.read_text(encoding="utf-8") == schema_text(), "run `python -m docs.fleet_reference`"
