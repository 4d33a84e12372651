"""Which board a command is for when no address is given."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from servolink.cli.main import refuse
from servolink.cli.output import Table, console, show_table
from servolink.discovery.choice import NONE_HERE, boards, only
from servolink.discovery.search import search
from servolink.errors import OpenError
from servolink.printable import printable
from servolink.transports.candidate import Candidate


def chosen(args: argparse.Namespace) -> str:
    """Return the address in `args`, that of the only board here, or the one that is picked at the terminal.

    OpenError if there is none. Where nobody can be asked, several are wrong usage.
    """
    if args.url:
        return str(args.url)
    candidates = search()
    found = boards(candidates)
    usable = [board for board in found if not board.problem]
    if not found:
        raise OpenError(NONE_HERE)
    if len(found) == 1 or len(usable) == 1:
        return only(candidates)
    if not (sys.stdin and sys.stdin.isatty() and sys.stderr.isatty()) or args.json:
        addresses = "\n".join(f"  --url {printable(board.url)}" for board in found)
        refuse(args, f"{len(found)} boards are here; name one:\n{addresses}")
    return _picked(args, found)


def _picked(args: argparse.Namespace, found: Sequence[Candidate]) -> str:
    """Ask at the terminal."""
    rows = [(str(number), board.url, board.product, board.problem) for number, board in enumerate(found, 1)]
    terminal = console(stderr=True)
    show_table(Table(("", "address", "product", "problem"), rows), terminal)
    terminal.print(f"Which one? 1 to {len(found)}:", end=" ")
    answer = sys.stdin.readline().strip()
    if not (answer.isascii() and answer.isdecimal() and 1 <= int(answer) <= len(found)):
        refuse(args, f"{answer!r} is none of them; give --url")
    return found[int(answer) - 1].url
