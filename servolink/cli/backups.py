"""`servolink backups`: what was on boards before imports."""

from __future__ import annotations

import argparse

from servolink.cli.main import OK
from servolink.cli.output import Table, print_json, print_table, print_text
from servolink.project.store import Store


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add nothing: `servolink backups` has no options of its own."""


def run(args: argparse.Namespace) -> int:
    """List all backups, the newest last."""
    store = Store()
    backups = store.backups()
    if args.json:
        described = [
            {"time": backup.time.isoformat(), "board": backup.board, "file": str(backup.path)} for backup in backups
        ]
        print_json({"backups": described})
    elif backups:
        rows = [(f"{backup.time:%Y-%m-%d %H:%M:%S} UTC", backup.board, str(backup.path)) for backup in backups]
        print_table(Table(("made", "board", "file"), rows))
    else:
        print_text(f"there are no backups in {store.folder}; `servolink apply` makes one before it changes a board")
    return OK
