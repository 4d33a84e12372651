"""Reading and writing of project files, and the JSON Schema of the format."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import NODEFAULT, UNSET, Meta, UnsetType

from servolink.errors import EncodeError, ProjectError, quote
from servolink.project.blocks import Blocks
from servolink.project.figure import Figure, refuse_newer
from servolink.project.model import Project
from servolink.protocol import convert, json_type, quote_json, record_from_json, record_to_json
from servolink.support import MAX_SIZE, read_file, read_json, reason, write_atomically, write_json

SCHEMA = 1
"""Version of the format, raised when an older servolink cannot read files of a newer servolink."""
_EDITOR_SCHEMA = msgspec.field(default=UNSET, name="$schema")
_HEAD = (
    ("schema", Annotated[Literal[SCHEMA], Meta(description="version of the format")], NODEFAULT),
    ("editor_schema", Annotated[str | UnsetType, Meta(description="JSON Schema, for editors")], _EDITOR_SCHEMA),
    (
        "values",
        Annotated[
            Literal["unchecked"] | UnsetType,
            Meta(description="in exports: the board holds values outside the ranges written by servolink"),
        ],
        UNSET,
    ),
    (
        "figure",
        Annotated[Figure | UnsetType, Meta(description="shape of the robot; never sent to a board")],
        UNSET,
    ),
    (
        "blocks",
        Annotated[Blocks | UnsetType, Meta(description="programs made of blocks; never sent to a board")],
        UNSET,
    ),
)
"""Fields of a file beyond the fields of the project."""


class ProjectFile(NamedTuple):
    """Content of a project file."""

    project: Project
    unchecked: bool = False
    """Whether the file was exported from a board with values outside the ranges written by servolink."""
    figure: Figure | None = None
    """Shape of the robot, stored on no board."""
    blocks: Blocks | None = None
    """Programs made of blocks, stored on no board."""

    @classmethod
    def read(cls, path: str | os.PathLike[str], *, unchecked: bool = False) -> ProjectFile:
        """Return the content of the file `path`, as by `load_project`."""
        file = _checked_path(path, "load_project(path)")
        try:
            content = read_file(file, MAX_SIZE)
        except (OSError, ValueError) as error:  # ValueError: NUL in the name
            raise ProjectError(f"{file}: cannot be read: {reason(error)}") from error
        try:
            return cls.parse(content, unchecked=unchecked)
        except ProjectError as error:
            raise ProjectError(f"{file}: {error}") from error

    @classmethod
    def parse(cls, text: str | bytes, *, unchecked: bool = False) -> ProjectFile:
        """Return the content of the text of a file, with records in the order of the text, as by `load_project`."""
        try:
            value = read_json(text)
            _check_version(value)
            unchecked = unchecked or value.get("values") == "unchecked"
            return cls.of_form(convert(value, cls.form_type(unchecked=unchecked)))
        except ValueError as error:  # EncodeError is a ValueError
            raise ProjectError(str(error)) from error

    @classmethod
    def of_form(cls, given: Any) -> ProjectFile:
        """Return the content of a file converted to `form_type`. Raise EncodeError for a wrong figure or blocks."""
        field = "figure"
        try:
            figure = None if given.figure is UNSET else given.figure.checked()
            field = "blocks"
            blocks = None if given.blocks is UNSET else given.blocks.checked()
        except EncodeError as error:
            raise EncodeError(error.text, f"{field}.{error.path}") from None
        return cls(record_from_json(Project, given), given.values == "unchecked", figure, blocks)

    @staticmethod
    def form_type(*, unchecked: bool) -> Any:
        """Return the msgspec type of a file: the type of a project, with fields that no board stores."""
        return json_type(Project, unchecked=unchecked, head=_HEAD)

    @classmethod
    def schema_text(cls) -> str:
        """Return the JSON Schema of project files, for completion and checks in editors."""
        described = msgspec.json.schema(cls.form_type(unchecked=False))
        head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "servolink project"}
        return json.dumps(head | described, indent=2) + "\n"

    def form(self) -> dict[str, Any]:
        """Return the object of the file, with the records in order of ids, ready for `json.dumps`."""
        head: dict[str, Any] = {"schema": SCHEMA} | ({"values": "unchecked"} if self.unchecked else {})
        drawn = {} if self.figure is None else {"figure": self.figure.to_json()}
        made = {} if self.blocks is None else {"blocks": self.blocks.to_json()}
        return {**head, **record_to_json(self.project.sorted()), **drawn, **made}

    def text(self) -> str:
        """Return the text of the file: equal for equal projects, even with meaningless values."""
        return write_json(self.form())

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file `path` as by `save_project`, even with errors that `load_project` refuses."""
        file = Path(path)
        _write(file, self.content_for(file))

    def content_for(self, file: Path) -> bytes:
        """Return the text for `file`. Figure and blocks that are not given are those of a replaced project file."""
        before = _replaced(file)
        content = self._replace(figure=self.figure or before.figure, blocks=self.blocks or before.blocks)
        text = content.text().encode()
        if len(text) > MAX_SIZE:
            raise ProjectError(f"{file}: would be larger than {MAX_SIZE >> 20} MiB, the limit for reading")
        return text


def load_project(path: str | os.PathLike[str], *, unchecked: bool = False) -> Project:
    """Return the project in the file `path`. Raise ProjectError naming the fault and the place.

    `unchecked` accepts all values that a board can have sent: numbers in the range of the wire but outside the
    document's, and captions with control characters.
    """
    return ProjectFile.read(path, unchecked=unchecked).project


def save_project(
    path: str | os.PathLike[str],
    project: Project,
    *,
    unchecked: bool = False,
    figure: Figure | None = None,
    blocks: Blocks | None = None,
) -> None:
    """Write `project` to the file `path`, whole or not at all.

    Args:
        path: File to write.
        project: Project to write, in the order of `project.sorted()`.
        unchecked: Whether to mark the file as an export with values outside the ranges written by servolink:
            `servolink apply` then writes the values unchanged.
        figure: Shape of the robot; if None, a replaced project file keeps the previous figure.
        blocks: Programs made of blocks; if None, a replaced project file keeps the previous blocks.

    Raises:
        ProjectError: The writing fails, or `load_project` would refuse the file.
    """
    if isinstance(path, Project):
        raise TypeError("save_project(path, project): the path comes first, then the project")
    file = _checked_path(path, "save_project(path, project)")
    if not isinstance(project, Project):
        raise TypeError(f"save_project(path, project): the project must be a Project, not {quote(project)}")
    content = ProjectFile(project, unchecked, figure, blocks).content_for(file)
    try:
        ProjectFile.parse(content)
    except ProjectError as error:
        raise ProjectError(f"{file}: was not written, because loading the text again would fail: {error}") from error
    _write(file, content)


def _write(file: Path, content: bytes) -> None:
    try:
        write_atomically(file, content)
    except (OSError, ValueError) as error:
        raise ProjectError(f"{file}: cannot be written: {reason(error)}") from error


def _replaced(file: Path) -> ProjectFile:
    """Return the content of a file that may be missing, or anything else."""
    try:
        return ProjectFile.read(file, unchecked=True)
    except ProjectError:
        return ProjectFile(Project())


def _checked_path(path: object, call: str) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(f"{call}: the path must be text or a Path, not {quote(path)}")
    return Path(path)


def _check_version(value: Any) -> None:
    """Raise EncodeError unless `value` has the format of this library."""
    if not isinstance(value, dict):
        raise EncodeError(f"is not a project file: a JSON object is needed, not {quote_json(value)}")
    if "schema" not in value:
        raise EncodeError(f'"schema" is missing; a project file begins with "schema": {SCHEMA}')
    version = value["schema"]
    if type(version) is not int or version < SCHEMA:
        raise EncodeError(f"must be {SCHEMA}, the version of the format, not {quote_json(version)}", "schema")
    if version > SCHEMA:
        raise EncodeError(
            f"{version} is newer than {SCHEMA}, the newest this servolink reads; update servolink", "schema"
        )
    for part in {"figure", "blocks"} & value.keys():
        try:
            refuse_newer(value[part], part)
        except EncodeError as error:
            raise EncodeError(error.text, f"{part}.{error.path}") from None
