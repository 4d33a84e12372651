"""Read and write project files, and their JSON Schema."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import NODEFAULT, UNSET, Meta, UnsetType

from servolink.errors import EncodeError, ProjectError
from servolink.escaping import quote
from servolink.files import read_file, reason, write_atomically
from servolink.json_text import MAX_SIZE, read_json, write_json
from servolink.project.figure import Figure, checked_figure, figure_to_json, refuse_newer
from servolink.project.model import Project
from servolink.protocol.json_errors import convert, quote_json
from servolink.protocol.json_form import json_type, record_to_json, struct_from_json

SCHEMA = 1
"""The version of the format. It grows when an older servolink cannot read what a newer one writes."""
_EDITOR_SCHEMA = msgspec.field(default=UNSET, name="$schema")
_HEAD = (
    ("schema", Annotated[Literal[SCHEMA], Meta(description="version of the format")], NODEFAULT),
    ("editor_schema", Annotated[str | UnsetType, Meta(description="JSON Schema, for editors")], _EDITOR_SCHEMA),
    (
        "values",
        Annotated[
            Literal["unchecked"] | UnsetType,
            Meta(description="in exports: the board holds values that servolink would not write unasked"),
        ],
        UNSET,
    ),
    (
        "figure",
        Annotated[Figure | UnsetType, Meta(description="what the robot looks like; never sent to a board")],
        UNSET,
    ),
)
"""The fields of a file that are not those of the project."""

SHIPPED = Path(__file__).with_name("servolink-project.schema.json")
"""The JSON Schema that is part of the package, equal to `schema_text()`."""


class ProjectFile(NamedTuple):
    """The content of a project file."""

    project: Project
    unchecked: bool
    """Whether the file was exported from a board with values that servolink would not write unasked."""
    figure: Figure | None = None
    """What the robot looks like; no board stores it."""


def load_project(path: str | os.PathLike[str], *, unchecked: bool = False) -> Project:
    """Return the project in the file `path`. Raise ProjectError naming what is wrong, and where.

    `unchecked` accepts everything that a board can have sent: numbers that the wire carries and the document does not
    allow, and captions with control characters.
    """
    return read_project_file(path, unchecked=unchecked).project


def read_project_file(path: str | os.PathLike[str], *, unchecked: bool = False) -> ProjectFile:
    """Return the content of the file `path`, as `load_project` does."""
    file = _checked_path(path, "load_project(path)")
    try:
        content = read_file(file, MAX_SIZE)
    except (OSError, ValueError) as error:  # ValueError: NUL in the name
        raise ProjectError(f"{file}: cannot be read: {reason(error)}") from error
    try:
        return parse_project_file(content, unchecked=unchecked)
    except ProjectError as error:
        raise ProjectError(f"{file}: {error}") from error


def parse_project(text: str | bytes, *, unchecked: bool = False) -> Project:
    """Return the project of the text of a file, with its records in the order of the text, as `load_project` does."""
    return parse_project_file(text, unchecked=unchecked).project


def parse_project_file(text: str | bytes, *, unchecked: bool = False) -> ProjectFile:
    """Return the content of the text of a file, as `load_project` does."""
    try:
        value = read_json(text)
        _check_version(value)
        unchecked = unchecked or value.get("values") == "unchecked"
        return project_from_form(convert(value, file_type(unchecked=unchecked)))
    except ValueError as error:  # EncodeError is a ValueError
        raise ProjectError(str(error)) from error


def project_from_form(given: Any) -> ProjectFile:
    """Return the content of a file as it was converted to `file_type`. Raise EncodeError for a wrong figure."""
    try:
        figure = None if given.figure is UNSET else checked_figure(given.figure)
    except EncodeError as error:
        raise EncodeError(error.text, f"figure.{error.path}") from None
    return ProjectFile(struct_from_json(Project, given), given.values == "unchecked", figure)


def project_to_form(project: Project, *, unchecked: bool = False, figure: Figure | None = None) -> dict[str, Any]:
    """Return the object of a file for `project.sorted()`, ready for `json.dumps`."""
    head: dict[str, Any] = {"schema": SCHEMA} | ({"values": "unchecked"} if unchecked else {})
    drawn = {} if figure is None else {"figure": figure_to_json(figure)}
    return {**head, **record_to_json(project.sorted()), **drawn}


def save_project(
    path: str | os.PathLike[str], project: Project, *, unchecked: bool = False, figure: Figure | None = None
) -> None:
    """Write `project` to the file `path`, whole or not at all.

    Raise ProjectError if that fails, or if `load_project` would refuse the file. `unchecked` marks the file as an
    export of values that servolink would not write unasked: `servolink apply` then writes them as they are. Without
    `figure`, a project file that is replaced keeps its own.
    """
    if isinstance(path, Project):
        raise TypeError("save_project(path, project): the path comes first, then the project")
    file = _checked_path(path, "save_project(path, project)")
    if not isinstance(project, Project):
        raise TypeError(f"save_project(path, project): the project must be a Project, not {quote(project)}")
    content = _content(file, project, unchecked=unchecked, figure=figure)
    try:
        parse_project_file(content)
    except ProjectError as error:
        raise ProjectError(f"{file}: was not written, because it could not be loaded again: {error}") from error
    _write(file, content)


def save_repaired(path: str | os.PathLike[str], project: Project, *, unchecked: bool = False) -> None:
    """Write the file `path` as `save_project` does, even if errors remain that it had before."""
    file = Path(path)
    _write(file, _content(file, project, unchecked=unchecked, figure=None))


def _content(file: Path, project: Project, *, unchecked: bool, figure: Figure | None) -> bytes:
    content = format_project(project, unchecked=unchecked, figure=figure or _figure_in(file)).encode()
    if len(content) > MAX_SIZE:
        raise ProjectError(f"{file}: would be larger than {MAX_SIZE >> 20} MiB, the most that can be read again")
    return content


def _write(file: Path, content: bytes) -> None:
    try:
        write_atomically(file, content)
    except (OSError, ValueError) as error:
        raise ProjectError(f"{file}: cannot be written: {reason(error)}") from error


def _figure_in(file: Path) -> Figure | None:
    """Return the figure of a file that may not exist, or be anything else."""
    try:
        return read_project_file(file, unchecked=True).figure
    except ProjectError:
        return None


def format_project(project: Project, *, unchecked: bool = False, figure: Figure | None = None) -> str:
    """Return the text of a file for `project.sorted()`: equal for equal projects, even with values of no meaning."""
    return write_json(project_to_form(project, unchecked=unchecked, figure=figure))


def schema_text() -> str:
    """Return the JSON Schema of project files, with which editors complete and check them."""
    described = msgspec.json.schema(file_type(unchecked=False))
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "servolink project"}
    return json.dumps(head | described, indent=2) + "\n"


def file_type(*, unchecked: bool) -> Any:
    """Return the msgspec type of a file: that of a project, with the fields that no board stores."""
    return json_type(Project, unchecked=unchecked, head=_HEAD)


def _checked_path(path: object, call: str) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(f"{call}: the path must be text or a Path, not {quote(path)}")
    return Path(path)


def _check_version(value: Any) -> None:
    """Raise EncodeError unless `value` is in the format that this library reads."""
    if not isinstance(value, dict):
        raise EncodeError(f"is not a project file: it needs a JSON object, not {quote_json(value)}")
    if "schema" not in value:
        raise EncodeError(f'"schema" is missing; a project file begins with "schema": {SCHEMA}')
    version = value["schema"]
    if type(version) is not int or version < SCHEMA:
        raise EncodeError(f"must be {SCHEMA}, the version of the format, not {quote_json(version)}", "schema")
    if version > SCHEMA:
        raise EncodeError(
            f"{version} is newer than {SCHEMA}, the newest this servolink reads; update servolink", "schema"
        )
    try:
        refuse_newer(value.get("figure"))
    except EncodeError as error:
        raise EncodeError(error.text, f"figure.{error.path}") from None
