"""`servolink export` and `servolink backups`: save a board in a project file, and list the backups of imports."""

from __future__ import annotations

import argparse
from pathlib import Path

from msgspec.structs import replace

from servolink.cli.arguments import new_file
from servolink.cli.command import PROJECTS, Command, flag, option
from servolink.cli.command_session import KEEP_MODE, Interruption, agreed, refuse_unasked, run_with_board
from servolink.cli.screen.live import shown_progress
from servolink.cli.screen.output import Table, counted, print_error, print_json, print_result, print_table, print_text
from servolink.client.board import Board
from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project, is_unfinished
from servolink.project.project_file import load_project, save_project
from servolink.project.transfer.backups import BackupStore
from servolink.project.validate import validate_project
from servolink.protocol.record_types import STORED_TYPES
from servolink.script import FAILED, OK


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

    async def talk(board: Board, interruption: Interruption) -> int:
        if is_there and not await agreed(args, interruption, f"{args.file} exists. Replace it?"):
            return FAILED
        with shown_progress(board, quiet=args.json) as on_progress:
            project = await board.export_project(on_progress=on_progress)
        if is_unfinished(project.project_id):  # the id of an interrupted import, which no file may give to a board
            project = replace(project, project_id=0)
        odd = _first_error(project, board.codec.caption_encoding)
        save_project(args.file, project, unchecked=bool(odd))
        interruption.state = f"{args.file} is written"
        counts = {kind.field: len(getattr(project, kind.field)) for kind in STORED_TYPES}
        texts = ", ".join(counted(counts[kind.field], kind.label) for kind in STORED_TYPES)
        print_result(
            args,
            {"file": str(args.file), "project_id": project.project_id, **counts},
            f"{args.file}: project {project.project_id or 'without id'}, {texts}",
        )
        if odd:
            print_error(
                "servolink: the board holds values outside the ranges written by servolink, such as "
                f"{escape(odd)}; `servolink apply` of this file writes them as they are"
            )
        return OK

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
def run_backups(args: argparse.Namespace) -> int:
    """List all backups, the newest last."""
    store = BackupStore()
    backups = store.backups()
    if args.json:
        described = [
            {"number": backup.number, "time": backup.time.isoformat(), "board": backup.board, "file": str(backup.path)}
            for backup in backups
        ]
        print_json({"backups": described})
    elif backups:
        rows = [(backup.number, f"{backup.time:%Y-%m-%d %H:%M:%S} UTC", backup.board) for backup in backups]
        print_table(Table(("number", "made", "board"), rows))
        print_text(f"in {backups[-1].path.parent}; `servolink rollback NUMBER` restores one")
    else:
        print_text(f"there are no backups in {store.folder}; `servolink apply` saves one before it changes a board")
    return OK


def backup_named(name: str) -> Path:
    """Return the backup with this number, or the file `name`. Raise ProjectError for a number without a backup."""
    if not name.isdecimal() or Path(name).exists():
        return Path(name)
    for backup in BackupStore().backups():
        if str(backup.number) == name.lstrip("0"):
            return backup.path
    raise ProjectError(f"there is no backup {name}; `servolink backups` lists all backups")
