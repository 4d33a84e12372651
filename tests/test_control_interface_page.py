"""The page and the JSON Schema of the control interface."""

from __future__ import annotations

import json

import pytest

from docs.control_interface import control_interface, schema
from servolink.control import NOTIFICATIONS
from servolink.hub import METHODS
from tests.tables import over


@pytest.fixture(scope="module")
def page() -> str:
    """The page, which takes a while to make."""
    return control_interface()


@over("name", [*METHODS, *NOTIFICATIONS])
def test_every_method_and_notification_has_a_section(name: str, page: str) -> None:
    assert f"\n### {name}\n" in page


def test_the_schema_defines_all_that_it_refers_to() -> None:
    text = json.dumps(schema())
    defined = schema()["$defs"]
    referred = {part.partition('"')[0] for part in text.split('"#/$defs/')[1:]}
    assert referred <= set(defined)
    assert set(schema()["methods"]) == set(METHODS)
