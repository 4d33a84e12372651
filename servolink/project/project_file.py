"""The JSON Schema of project files, with which editors complete and check them."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec

from servolink.errors import ProjectError
from servolink.escaping import escape, quote
from servolink.files import read_file, reason, write_atomically
from servolink.json_text import MAX_SIZE, place, read_text, write_text
from servolink.project.model import Project
from servolink.protocol.json_errors import fault, version_fault
from servolink.protocol.json_form import file_type, of_file, to_file

SHIPPED = Path(__file__).with_name("servolink-project.schema.json")
"""The file that comes with servolink; it is `schema_text()`."""


def schema_text() -> str:
    """Return the JSON Schema of what `load_project` takes."""
    described = msgspec.json.schema(file_type(Project, unchecked=False))
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "servolink project"}
    return json.dumps(head | described, indent=2) + "\n"


def load_project(path: Path, *, unchecked: bool = False) -> Project:
    """Return the project in the file `path`; ProjectError says what is wrong with it, and where.

    `unchecked` lets pass what a board can have said and this library would not say by itself: numbers that the wire
    carries and the document does not allow, captions with control characters.
    """
    name = escape(str(path))
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
    said = read_text(text)
    if problem := version_fault(said):
        raise ProjectError(problem)
    form = file_type(Project, unchecked=unchecked)
    try:
        project: Project = of_file(Project, msgspec.convert(said, form))
    except msgspec.ValidationError as error:
        raise ProjectError(": ".join(filter(None, fault(str(error), said, form)))) from None
    except UnicodeEncodeError as error:
        what = f"{quote(error.object)} names neither a field nor a type"
        raise ProjectError(": ".join(filter(None, (place(said, error.object), what)))) from None
    return project


def format_project(project: Project) -> str:
    """Return the text for `project.sorted()`: the same for equal contents, with whatever a board said."""
    return write_text(to_file(project.sorted()))


def save_project(path: Path, project: Project) -> None:
    """Write `project` to `path`, whole or not at all; ProjectError if it cannot be written."""
    name, content = escape(str(path)), format_project(project).encode()
    if len(content) > MAX_SIZE:
        raise ProjectError(f"{name}: would be larger than the {MAX_SIZE >> 20} MiB that can be read again")
    try:
        write_atomically(path, content)
    except (OSError, ValueError) as error:
        raise ProjectError(f"{name}: cannot be written: {reason(error)}") from error
