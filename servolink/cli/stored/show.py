"""`servolink action list` and `show`, the same of macros and tables, and their short forms `servolink actions`."""

from __future__ import annotations

import argparse
from typing import Any

from servolink.cli.arguments import RECORD_NAME
from servolink.cli.main import OK
from servolink.cli.screen.output import Table, print_json, print_table, print_text
from servolink.cli.session import Interruption, run_with_board
from servolink.cli.stored.records import record_table
from servolink.client.board import Board
from servolink.protocol.json_form import record_to_json
from servolink.protocol.record_types import ACTION, MACRO, TABLE, RecordType


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink actions`, `macros` or `tables`."""
    parser.set_defaults(run=run)
    parser.add_argument(
        "record", nargs="?", type=RECORD_NAME, metavar="NAME", help="show this one in full; caption or id"
    )


def configure_list(parser: argparse.ArgumentParser) -> None:
    """Set what runs; `list` has no options of its own."""
    parser.set_defaults(run=run, record=None)


def configure_show(parser: argparse.ArgumentParser) -> None:
    """Add the options of `show`."""
    parser.set_defaults(run=run)
    parser.add_argument("record", type=RECORD_NAME, metavar="NAME", help="its caption or id, as in the list")


def kind_of(args: argparse.Namespace) -> RecordType[Any]:
    """Return the type of record that the command is about."""
    kinds: dict[str, RecordType[Any]] = {"action": ACTION, "macro": MACRO, "table": TABLE}
    return kinds[args.command.removesuffix("s")]


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
