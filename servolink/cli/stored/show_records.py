"""`servolink action list` and `show`, the same of macros and tables, and their short forms `servolink actions`."""

from __future__ import annotations

import argparse
from typing import Any

from msgspec import UNSET, UnsetType

from servolink.cli.arguments import RECORD_NAME
from servolink.cli.command import STORED, Command, option
from servolink.cli.command_session import KEEP_MODE, Interruption, on_board
from servolink.cli.screen.output import Table
from servolink.cli.screen.result import CommandResult, Returned
from servolink.cli.stored import NOUNS, a
from servolink.cli.stored.record_tables import record_table
from servolink.client import Board
from servolink.protocol import ACTION, MACRO, TABLE, RecordType, record_to_json


class StoredRecords(CommandResult, frozen=True, kw_only=True):
    """JSON of `actions`, `macros`, `tables`, `action list`, `macro list` and `table list`: entries of one type."""

    actions: list[dict[str, Any]] | UnsetType = UNSET
    macros: list[dict[str, Any]] | UnsetType = UNSET
    joystick_tables: list[dict[str, Any]] | UnsetType = UNSET


@on_board()
async def run(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Return the list, or one record."""
    kind = kind_of(args)
    if args.record is None:
        return await _list(board, kind)
    read: Any = {ACTION: board.action, MACRO: board.macro, TABLE: board.joystick_table}[kind]
    record = await read(args.record)
    return Returned(record_to_json(record), record_table(record))


NAME = option("record", "NAME", "its caption or id, as in the list", RECORD_NAME)
_ANY_NAME = option("record", "NAME", "show this one in full; caption or id", RECORD_NAME, nargs="?")
COMMANDS = tuple(
    command(run)
    for noun, several in NOUNS.items()
    for command in (
        Command(
            f"{noun}s",
            STORED,
            help=f"list the {several} stored on the board, or show one",
            examples=(f"{noun}s", f"{noun}s 1"),
            options=(_ANY_NAME, KEEP_MODE),
            needs_records=True,
        ),
        Command(
            f"{noun} list",
            help=f"list the {several} stored on the board",
            examples=(f"{noun} list",),
            options=(KEEP_MODE,),
            defaults={"record": None},
            needs_records=True,
        ),
        Command(
            f"{noun} show",
            help=f"show {a(noun)} in full",
            examples=(f"{noun} show 1", f"{noun} show 1 --json"),
            options=(NAME, KEEP_MODE),
            needs_records=True,
        ),
    )
)


def kind_of(args: argparse.Namespace) -> RecordType[Any]:
    """Return the type of record that the command is about."""
    kinds: dict[str, RecordType[Any]] = {"action": ACTION, "macro": MACRO, "table": TABLE}
    return kinds[args.command.partition(" ")[0].removesuffix("s")]


async def _list(board: Board, kind: RecordType[Any]) -> Returned:
    active = await board.active_joystick_table() if kind is TABLE else None
    entries = kind.entries_in(await board.request(kind.list_request))
    is_active = [[kind.id_of(one) == active] if kind is TABLE else [] for one in entries]
    records = [
        record_to_json(one) | dict(zip(("is_active",), is_it, strict=False))
        for one, is_it in zip(entries, is_active, strict=True)
    ]
    value = StoredRecords(**{kind.field: records})
    if not entries:
        return Returned(value, f"no {kind} is stored on the board")
    rows = [(kind.id_of(one), kind.caption_of(one), *is_it) for one, is_it in zip(entries, is_active, strict=True)]
    return Returned(value, Table((kind.label, "caption", *(["active"] if kind is TABLE else [])), rows))
