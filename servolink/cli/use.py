"""`servolink use`: a name for a board."""

from __future__ import annotations

import argparse

from servolink.cli.main import OK, refuse
from servolink.cli.output import print_json, print_text
from servolink.discovery.aliases import aliases_path, is_name, save_alias
from servolink.discovery.resolve import alias_for
from servolink.discovery.search import search


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink use`."""
    parser.add_argument("name", metavar="NAME", help="of letters, digits, - and _")
    parser.add_argument("address", metavar="URL", help="the board's address, as `servolink list` shows it")


def run(args: argparse.Namespace) -> int:
    """Keep the name; nothing is opened."""
    if not is_name(args.name):
        refuse(args, f"{args.name!r} cannot be a name: up to 64 letters, digits, - and _, and no port")
    alias = alias_for(args.address, search())
    save_alias(args.name, alias)
    if args.json:
        print_json({"name": args.name, "url": alias.url, "serial_number": alias.serial_number})
    else:
        board = (
            f"the board with serial number {alias.serial_number}, on whatever port"
            if alias.serial_number
            else alias.url
        )
        print_text(f"{args.name} is {board}; kept in {aliases_path()}")
    return OK
