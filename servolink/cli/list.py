"""`servolink list`: the boards that are here."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from servolink.cli.main import NO_BOARD, OK, fail
from servolink.cli.output import Table, print_json, print_table
from servolink.cli.session import Interruption, run_interruptible
from servolink.discovery.aliases import Alias, load_aliases
from servolink.discovery.choice import NONE_HERE
from servolink.discovery.resolve import current_url
from servolink.discovery.search import discover
from servolink.doctor.probe import Heard, probe
from servolink.errors import OpenError
from servolink.transports.candidate import Candidate


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink list`."""
    parser.add_argument("--probe", action="store_true", help="open each and ask whether it is a board")


def run(args: argparse.Namespace) -> int:
    """Print what may be a board; nothing is opened but with --probe."""

    async def main(interruption: Interruption) -> int:
        candidates = await discover()
        names = _names(load_aliases(), candidates)
        heard = await asyncio.gather(*(probe(candidate.url) for candidate in candidates)) if args.probe else []
        if args.json:
            boards = [asdict(candidate) | {"name": names.get(candidate.url)} for candidate in candidates]
            if heard:
                boards = [board | _described(sound) for board, sound in zip(boards, heard, strict=True)]
            print_json({"boards": boards})
        elif candidates:
            print_table(_table(candidates, names, heard))
        if candidates:
            return OK
        return NO_BOARD if args.json else fail(OpenError(NONE_HERE), NO_BOARD)

    return run_interruptible(main, "nothing was changed")


def _names(aliases: Mapping[str, Alias], candidates: list[Candidate]) -> dict[str, str]:
    """Return the names of the boards that are here, by address."""
    names: dict[str, str] = {}
    for name, alias in aliases.items():
        try:
            url = current_url(name, alias, candidates)
        except OpenError:  # it is not here
            continue
        names[url.partition("?")[0]] = name
    bare = {candidate.url: candidate.url.partition("?")[0] for candidate in candidates}
    return {url: names[place] for url, place in bare.items() if place in names}


def _described(heard: Heard) -> dict[str, Any]:
    return {"answer": heard.answer and asdict(heard.answer), "problem": heard.problem}


def _table(candidates: list[Candidate], names: Mapping[str, str], heard: list[Heard]) -> Table:
    columns = ["address", "name", "product", "serial number", "problem"]
    rows: list[list[object]] = [
        [each.url, names.get(each.url), each.product, each.serial_number, each.problem] for each in candidates
    ]
    if heard:
        columns.insert(4, "answer")
        for row, sound in zip(rows, heard, strict=True):
            row[4:] = [_answer(sound), sound.problem]
    return Table(columns, rows)


def _answer(heard: Heard) -> str:
    if heard.answer is None:
        return "" if heard.problem else "none"
    mode = "" if heard.answer.transmission_mode == 1 else ", was in the old transmission mode"
    return f"project id {heard.answer.project_id}, {heard.answer.byte_order} byte order{mode}"
