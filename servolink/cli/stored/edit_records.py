"""`add`, `set`, `rename` and `delete` of `servolink action`, `macro` and `table`, and `servolink table activate`."""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

from servolink.cli.command_session import UNTOUCHED, Interruption, on_board, refuse_without_answer
from servolink.cli.screen.result import CommandResult, Returned
from servolink.cli.stored.change import change_board
from servolink.cli.stored.given import empty, maker, stored_record
from servolink.cli.stored.show_records import kind_of
from servolink.cli.usage import usage_error
from servolink.client import ALL, Board
from servolink.errors import NotFound, ProjectError
from servolink.project import (
    Project,
    add_from,
    add_record,
    load_project,
    name_of,
    remove_records,
    replace_from,
    replace_record,
    with_caption,
    with_id,
)
from servolink.protocol import RecordType


def run_add(args: argparse.Namespace) -> int:
    """Store a record that is not there yet."""
    kind = kind_of(args)
    if args.source is not None:
        if args.id is not None:
            usage_error(args, "--id and --from are both given; the record keeps the id of the file if it is free")
        source, record = _from_file(args, kind)
        return change_board(
            args, lambda project, encoding: add_from(project, source, record, caption_encoding=encoding)
        )
    make = maker(args, kind)
    caption = "" if args.what.startswith(("{", "@")) or args.what == "-" else args.what

    def edit(project: Project, encoding: str) -> Project:
        record = make(empty(kind, caption, 0), project)
        if args.id is not None:
            record = with_id(record, args.id)
        return add_record(project, record, caption_encoding=encoding)

    return change_board(args, edit, prepare=partial(_expand_all, args))


def run_set(args: argparse.Namespace) -> int:
    """Change a record that is there."""
    kind = kind_of(args)
    if args.source is not None:
        return _set_from_file(args, kind)
    make = maker(args, kind)

    def edit(project: Project, encoding: str) -> Project:
        old = stored_record(project, kind, args.record)
        record = make(old, project)
        if kind.id_of(record) != kind.id_of(old):
            raise ProjectError(
                f"the JSON has the id {kind.id_of(record)}, not {kind.id_of(old)}; leave it out; {UNTOUCHED}"
            )
        return replace_record(project, record, caption_encoding=encoding)

    return change_board(args, edit, prepare=partial(_expand_all, args))


async def _expand_all(args: argparse.Namespace, board: Board) -> None:
    """Replace `all` in a pose by each servo of the board: a stored action names them."""
    pose = getattr(args, "pose", None)
    if pose is None or ALL not in [servo for servo, _ in pose]:
        return
    every = dict.fromkeys(await board.servo_ids())
    if not every:
        raise NotFound(f"the board has no servos; {UNTOUCHED}")
    args.pose = [(each, angle) for servo, angle in pose for each in (every if servo == ALL else (servo,))]


def _set_from_file(args: argparse.Namespace, kind: RecordType[Any]) -> int:
    if args.what is None:
        usage_error(args, "say which record of the file: its caption or its id")
    source, record = _from_file(args, kind)

    def edit(project: Project, encoding: str) -> Project:
        record_id = kind.id_of(stored_record(project, kind, args.record))
        return replace_from(project, source, record, record_id, caption_encoding=encoding)

    return change_board(args, edit)


def _from_file(args: argparse.Namespace, kind: RecordType[Any]) -> tuple[Project, Any]:
    """Return the project file and the record named in `args`. Raise ProjectError for a missing record."""
    if any(getattr(args, name, None) is not None for name in ("pose", "seconds", "play", "press", "long_press", "up")):
        usage_error(args, f"{args.needed} and --from are both given; choose one")
    source = load_project(args.source, unchecked=True)
    return source, source.find(args.what, (kind,))


def run_rename(args: argparse.Namespace) -> int:
    """Give a record another caption."""
    kind = kind_of(args)

    def edit(project: Project, encoding: str) -> Project:
        record = with_caption(stored_record(project, kind, args.record), args.caption)
        return replace_record(project, record, caption_encoding=encoding)

    return change_board(args, edit)


def run_delete(args: argparse.Namespace) -> int:
    """Delete records, after asking."""
    refuse_without_answer(args)
    kind = kind_of(args)

    def edit(project: Project, encoding: str) -> Project:
        return remove_records(project, kind, {kind.id_of(stored_record(project, kind, name)) for name in args.record})

    return change_board(args, edit)


class TableActivated(CommandResult, frozen=True):
    """JSON of `table activate`: the id of the active table."""

    active_joystick_table: int


@on_board(state=UNTOUCHED)
async def run_activate(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Activate a joystick table, and read the active table back."""
    table = await board.joystick_table(args.record)
    interruption.state = f"{name_of(table)} may be active"
    await board.set_active_joystick_table(table.table_id)
    active = await board.active_joystick_table()
    interruption.state = f"joystick table {active or 'none'} is active"
    if active != table.table_id:
        raise ProjectError(f"{board.url} accepted {name_of(table)}, but reports {active or 'none'} as active")
    return Returned(TableActivated(table.table_id), f"{name_of(table)} is active")
