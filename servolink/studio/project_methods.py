"""The methods for project files and backups: the page has neither a file system nor the checks of the library."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from msgspec import Meta, Struct

from servolink.boards import ProfileInUse
from servolink.control import ProjectExported, ProjectForm, Role, Touches
from servolink.errors import ProjectError
from servolink.motion import INTERVAL_UNIT
from servolink.project import (
    BackupStore,
    Diagnostic,
    Figure,
    Mirror,
    Project,
    ProjectFile,
    preflight,
    validate_project,
)
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.support import computed, write_json


class FileText(Struct, forbid_unknown_fields=True):
    """The text of a project file."""

    text: str


class FileContent(Struct, frozen=True):
    """The text of a project file."""

    text: str


class SomeProject(Struct, forbid_unknown_fields=True):
    """Project, in the form of a project file."""

    project: ProjectForm


class Found(Struct, frozen=True):
    """Fault or oddity in a project."""

    path: str
    text: str
    severity: str
    """`error` for content that no board would store, otherwise `warning`."""


class Checked(Struct, frozen=True):
    """Findings, errors first."""

    found: tuple[Found, ...]


class BackupNumber(Struct, forbid_unknown_fields=True):
    """The number of a backup."""

    number: Annotated[int, Meta(ge=0)]


ById: TypeAlias = dict[Annotated[str, Meta(pattern="^-?[0-9]{1,10}$")], Annotated[str, Meta(max_length=256)]]
"""Captions by id."""


class Sides(Struct, forbid_unknown_fields=True):
    """What tells the left of a robot from its right."""

    captions: ById
    """Captions of the servos."""
    figure: Figure | None = None


class Images(Struct, frozen=True):
    """Mirror images of servos by servo id."""

    images: dict[int, Mirror.ServoImage]


@METHODS.add("project.images", Role.WATCH, touches=Touches.NOTHING)
@computed
def images(caller: PageCaller, params: Sides) -> Images:
    """Return the mirror image of each servo that has one."""
    captions = {int(servo_id): caption for servo_id, caption in params.captions.items()}
    return Images(Mirror.images(params.figure, captions))


@METHODS.add("studio.file.read", Role.WATCH, touches=Touches.NOTHING)
@computed
def file_read(caller: PageCaller, params: FileText) -> ProjectExported:
    """Return the project in the text of a file. ProjectError names the fault and the place."""
    return ProjectExported(_form_of(ProjectFile.parse(params.text)))


@METHODS.add("studio.file.write", Role.WATCH, touches=Touches.NOTHING)
@computed
def file_write(caller: PageCaller, params: SomeProject) -> FileContent:
    """Return the text of the file for a project, as `servolink export` writes it."""
    return FileContent(write_json(_form_of(ProjectFile.of_form(params.project))))


def _form_of(file: ProjectFile) -> dict[str, Any]:
    return ProjectFile(file.project, unchecked=file.unchecked, figure=file.figure, blocks=file.blocks).form()


@METHODS.add("studio.check", Role.WATCH, touches=Touches.NOTHING)
@computed
def check(caller: PageCaller, params: SomeProject) -> Checked:
    """Return faults and oddities of a project, and movements too fast or too far for the board."""
    found = findings(ProjectFile.of_form(params.project).project, caller.profile)
    ordered = sorted(found, key=lambda one: one.severity != "error")
    return Checked(tuple(Found(one.path, one.text, one.severity) for one in ordered))


def findings(project: Project, profile: ProfileInUse | None) -> list[Diagnostic]:
    """Return faults and oddities of a project on a board with this profile."""
    found = validate_project(project)
    if any(one.severity == "error" for one in found):  # such as endless macros, which take no time
        return found
    if profile is None:
        return found
    interval_unit = profile.settings.interval_unit or INTERVAL_UNIT
    return found + preflight(project, limits=profile.limits, interval_unit=interval_unit)


@METHODS.add("studio.backup", Role.EDIT, touches=Touches.NOTHING)
@computed
def backup(caller: PageCaller, params: BackupNumber) -> ProjectExported:
    """Return the content of a backup. ProjectError for an unknown number or a changed backup."""
    store = BackupStore()
    path = next((one.path for one in store.backups() if one.number == params.number), None)
    if path is None:
        raise ProjectError(f"there is no backup {params.number}; look at the list of backups again")
    project = store.load(path)
    is_odd = any(one.severity == "error" for one in validate_project(project))
    return ProjectExported(ProjectFile(project, unchecked=is_odd).form())
