"""The JSON Schema of project files, with which editors complete and check them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import NODEFAULT, UNSET, Meta, UnsetType

from servolink.errors import EncodeError, ProjectError
from servolink.files import read_file, reason, write_atomically
from servolink.json_text import MAX_SIZE, read_json, write_json
from servolink.project.model import Project
from servolink.protocol.json_errors import convert, quote_json
from servolink.protocol.json_form import json_type, record_to_json, struct_from_json

SCHEMA = 1
"""The version of the format; it grows when an older servolink could not read what a newer one writes."""
_EDITOR_SCHEMA = msgspec.field(default=UNSET, name="$schema")
_HEAD = (
    ("schema", Annotated[Literal[SCHEMA], Meta(description="version of the format")], NODEFAULT),
    ("editor_schema", Annotated[str | UnsetType, Meta(description="JSON Schema, for editors")], _EDITOR_SCHEMA),
)
"""The fields of a file before those of the project."""

SHIPPED = Path(__file__).with_name("servolink-project.schema.json")
"""The file that comes with servolink; it is `schema_text()`."""


def schema_text() -> str:
    """Return the JSON Schema of what `load_project` takes."""
    described = msgspec.json.schema(_file_type(unchecked=False))
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "servolink project"}
    return json.dumps(head | described, indent=2) + "\n"


def load_project(path: Path, *, unchecked: bool = False) -> Project:
    """Return the project in the file `path`; ProjectError says what is wrong with it, and where.

    `unchecked` lets pass what a board can have said and this library would not say by itself: numbers that the wire
    carries and the document does not allow, captions with control characters.
    """
    name = str(path)
    try:
        content = read_file(path, MAX_SIZE)
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        raise ProjectError(f"{name}: cannot be read: {reason(error)}") from error
    try:
        return parse_project(content, unchecked=unchecked)
    except ProjectError as error:
        raise ProjectError(f"{name}: {error}") from error


def parse_project(text: str | bytes, *, unchecked: bool = False) -> Project:
    """Return the project that `text` says, in the order in which it says it; otherwise as `load_project`."""
    try:
        value = read_json(text)
        _check_version(value)
        return struct_from_json(Project, convert(value, _file_type(unchecked=unchecked)))
    except ValueError as error:  # EncodeError is one as well
        raise ProjectError(str(error)) from error


def format_project(project: Project) -> str:
    """Return the text for `project.sorted()`: the same for equal contents, with whatever a board said."""
    return write_json({"schema": SCHEMA} | record_to_json(project.sorted()))


def save_project(path: Path, project: Project) -> None:
    """Write `project` to `path`, whole or not at all; ProjectError if it cannot be written."""
    name, content = str(path), format_project(project).encode()
    if len(content) > MAX_SIZE:
        raise ProjectError(f"{name}: would be larger than the {MAX_SIZE >> 20} MiB that can be read again")
    try:
        write_atomically(path, content)
    except (OSError, ValueError) as error:
        raise ProjectError(f"{name}: cannot be written: {reason(error)}") from error


def _file_type(*, unchecked: bool) -> Any:
    return json_type(Project, unchecked=unchecked, head=_HEAD)


def _check_version(value: Any) -> None:
    """Raise EncodeError unless `value` is in the format that this library reads."""
    if not isinstance(value, dict):
        raise EncodeError(f"must be an object, not {quote_json(value)}")
    if "schema" not in value:
        raise EncodeError(f'"schema" is missing; a project file begins with "schema": {SCHEMA}')
    version = value["schema"]
    if type(version) is not int or version < SCHEMA:
        raise EncodeError(f"must be {SCHEMA}, the version of the format, not {quote_json(version)}", "schema")
    if version > SCHEMA:
        raise EncodeError(f"{version} is newer than {SCHEMA}, the newest this servolink reads; update it", "schema")
