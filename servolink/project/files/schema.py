"""The JSON Schema of project files, with which editors complete and check them."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec

from servolink.project.files.file_types import file_type
from servolink.project.model import Project

SHIPPED = Path(__file__).with_name("servolink-project.schema.json")
"""The file that comes with servolink; it is `schema_text()`."""


def schema_text() -> str:
    """Return the JSON Schema of what `load_project` takes."""
    described = msgspec.json.schema(file_type(Project, exact=False))
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "servolink project"}
    return json.dumps(head | described, indent=2) + "\n"
