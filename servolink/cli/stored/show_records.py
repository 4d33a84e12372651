"""`servolink action list` and `show`, the same of macros and tables, and their short forms `servolink actions`."""

from __future__ import annotations

import argparse
from typing import Any

from servolink.cli.arguments import RECORD_NAME
from servolink.cli.command import STORED, Command, option
from servolink.cli.command_session import KEEP_MODE, Interruption, run_with_board
from servolink.cli.screen.output import Table, print_json, print_table, print_text
from servolink.cli.stored import NOUNS, a
from servolink.cli.stored.record_tables import record_table
from servolink.client.board import Board
from servolink.protocol.json_form import record_to_json
from servolink.protocol.record_types import ACTION, MACRO, TABLE, RecordType
from servolink.script import OK


def run(args: argparse.Namespace) -> int:
    """Print the list, or one record."""
    kind = kind_of(args)

    async def talk(board: Board, interruption: Interruption) -> int:
        if args.record is None:
            await _print_list(board, kind, json=args.json)
        else:
            read: Any = {ACTION: board.action, MACRO: board.macro, TABLE: board.joystick_table}[kind]
            record = await read(args.record)
            if args.json:
                print_json(record_to_json(record))
            else:
                print_table(record_table(record))
        return OK

    return run_with_board(args, talk)


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


async def _print_list(board: Board, kind: RecordType[Any], *, json: bool) -> None:
    active = await board.active_joystick_table() if kind is TABLE else None
    entries = kind.entries_in(await board.request(kind.list_request))
    if json:
        more = [{"is_active": kind.id_of(one) == active} if kind is TABLE else {} for one in entries]
        print_json({kind.field: [record_to_json(one) | extra for one, extra in zip(entries, more, strict=True)]})
    elif not entries:
        print_text(f"no {kind} is stored on the board")
    else:
        rows = [
            (kind.id_of(one), kind.caption_of(one), *([kind.id_of(one) == active] if kind is TABLE else []))
            for one in entries
        ]
        print_table(Table((kind.label, "caption", *(["active"] if kind is TABLE else [])), rows))
