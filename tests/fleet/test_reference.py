"""The page and the JSON Schema of the topics."""

from __future__ import annotations

import json

from docs.fleet_reference import fleet_reference, schema_text
from servolink.fleet.topics import METHODS, SENT


def test_the_page_has_each_topic_and_the_fields_of_its_payload() -> None:
    page = fleet_reference()
    for topic, (payload, _, _) in SENT.items():
        assert f"/{topic}` | [{payload.__name__}](#{payload.__name__.lower()}) |" in page
        assert f"### {payload.__name__}\n" in page
    for name, (params, _, _) in METHODS.items():
        assert f"`{name}`" in page
        assert f"### {params.__name__}\n" in page


def test_the_schema_defines_all_that_it_refers_to() -> None:
    text = schema_text()
    defined = json.loads(text)["$defs"]
    assert {part.partition('"')[0] for part in text.split('"#/$defs/')[1:]} <= set(defined)
    assert {payload.__name__ for payload, _, _ in SENT.values()} <= set(defined)
