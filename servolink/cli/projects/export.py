"""`servolink export` and `servolink backups`: save a board in a project file, and list the backups of imports."""

from __future__ import annotations

import argparse
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from servolink.cli.arguments import new_file
from servolink.cli.command import PROJECTS, Command, flag, option
from servolink.cli.command_session import KEEP_MODE, Interruption, agreed, refuse_unasked, run_with_board
from servolink.cli.screen.live import shown_progress
from servolink.cli.screen.output import Table, counted, print_error
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.client import Board
from servolink.errors import ProjectError, escape
from servolink.project import UNFINISHED, BackupStore, Project, load_project, save_project, validate_project
from servolink.protocol import STORED_TYPES
from servolink.support import ExitCode


class ContentExported(CommandResult, frozen=True, kw_only=True):
    """JSON of `export`, with the number of records of each type."""

    file: str
    project_id: int
    actions: int
    macros: int
    joystick_tables: int
    servo_parameters: int


class KeptBackup(Struct, frozen=True):
    """Backup of a board, made at `time`, in ISO 8601."""

    number: int
    time: str
    board: str
    file: str


class KeptBackups(CommandResult, frozen=True):
    """JSON of `backups`, the newest last."""

    backups: list[KeptBackup]


@Command(
    "export",
    PROJECTS,
    help="write everything on the board into a project file",
    examples=("export robot.servolink.json", "export robot.servolink.json --yes"),
    options=(
        option("file", "FILE", "such as robot.servolink.json", new_file),
        flag("--yes", "replace a project file without asking"),
        KEEP_MODE,
    ),
)
def run_export(args: argparse.Namespace) -> int:
    """Read everything from the board and write the file, whole or not at all, after asking if it exists."""
    _refuse_other_files(args.file)
    if is_there := args.file.exists():
        refuse_unasked(args, f"{args.file} exists; --yes replaces it")

    async def talk(board: Board, interruption: Interruption) -> Ending:
        if is_there and not await agreed(args, interruption, f"{args.file} exists. Replace it?"):
            return ExitCode.FAILED
        with shown_progress(board) as on_progress:
            project = await board.export_project(on_progress=on_progress)
        if project.project_id in UNFINISHED:  # the id of an interrupted import, which no file may give to a board
            project = replace(project, project_id=0)
        odd = _first_error(project, board.codec.caption_encoding)
        save_project(args.file, project, unchecked=bool(odd))
        interruption.state = f"{args.file} is written"
        counts = {kind.field: len(getattr(project, kind.field)) for kind in STORED_TYPES}
        texts = ", ".join(counted(counts[kind.field], kind.label) for kind in STORED_TYPES)
        if odd:
            print_error(
                "servolink: the board holds values outside the ranges written by servolink, such as "
                f"{escape(odd)}; `servolink apply` of this file writes them as they are"
            )
        return Returned(
            ContentExported(file=str(args.file), project_id=project.project_id, **counts),
            f"{args.file}: project {project.project_id or 'without id'}, {texts}",
        )

    return run_with_board(args, talk, state=f"{args.file} was not written")


def _first_error(project: Project, caption_encoding: str) -> str:
    """Return the first reason why `apply` would refuse the project from another file, empty if there is none."""
    found = validate_project(project, caption_encoding=caption_encoding)
    return next((str(one) for one in found if one.severity == "error"), "")


def _refuse_other_files(path: Path) -> None:
    """Raise ProjectError, before the board is read for nothing, rather than overwrite anything but a project file."""
    if not path.parent.is_dir():
        raise ProjectError(f"{path}: the folder does not exist; create it first, or choose another name")
    if path.exists():
        try:
            load_project(path, unchecked=True)
        except ProjectError as error:
            raise ProjectError(
                f"{path} exists and is not a project file, so it is not overwritten; choose another name"
            ) from error


@Command(
    "backups",
    PROJECTS,
    help="list what was on boards before imports",
    examples=("backups", "backups --json"),
    takes_board=False,
)
def run_backups(_: argparse.Namespace) -> Returned:
    """List all backups, the newest last."""
    store = BackupStore()
    backups = store.backups()
    value = KeptBackups([KeptBackup(one.number, one.time.isoformat(), one.board, str(one.path)) for one in backups])
    if not backups:
        none = f"there are no backups in {store.folder}; `servolink apply` saves one before it changes a board"
        return Returned(value, none)
    rows = [(backup.number, f"{backup.time:%Y-%m-%d %H:%M:%S} UTC", backup.board) for backup in backups]
    where = f"in {backups[-1].path.parent}; `servolink rollback NUMBER` restores one"
    return Returned(value, [Table(("number", "made", "board"), rows), where])


def backup_named(name: str) -> Path:
    """Return the backup with this number, or the file `name`. Raise ProjectError for a number without a backup."""
    if not name.isdecimal() or Path(name).exists():
        return Path(name)
    for backup in BackupStore().backups():
        if str(backup.number) == name.lstrip("0"):
            return backup.path
    raise ProjectError(f"there is no backup {name}; `servolink backups` lists all backups")
