"""`servolink backups`: what was on boards before imports."""

from __future__ import annotations

import argparse
from pathlib import Path

from servolink.cli.main import OK
from servolink.cli.output import Table, print_json, print_table, print_text
from servolink.errors import ProjectError
from servolink.project.imports.store import Store


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add nothing: `servolink backups` has no options of its own."""


def run(args: argparse.Namespace) -> int:
    """List all backups, the newest last."""
    store = Store()
    backups = store.backups()
    if args.json:
        described = [
            {
                "number": backup.number,
                "time": backup.time.isoformat(),
                "board": backup.board,
                "file": str(backup.path),
            }
            for backup in backups
        ]
        print_json({"backups": described})
    elif backups:
        rows = [(backup.number, f"{backup.time:%Y-%m-%d %H:%M:%S} UTC", backup.board) for backup in backups]
        print_table(Table(("number", "made", "board"), rows))
        print_text(f"in {backups[-1].path.parent}; `servolink rollback NUMBER` restores one")
    else:
        print_text(f"there are no backups in {store.folder}; `servolink apply` makes one before it changes a board")
    return OK


def backup_named(name: str) -> Path:
    """Return the backup with this number, or the file `name`; ProjectError if there is no such number."""
    if not name.isdecimal() or Path(name).exists():
        return Path(name)
    for backup in Store().backups():
        if str(backup.number) == name.lstrip("0"):
            return backup.path
    raise ProjectError(f"there is no backup {name}; `servolink backups` lists all there are")
