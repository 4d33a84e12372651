"""`servolink fleet doctor`: what is wrong with the broker, the network and the boards."""

from __future__ import annotations

import argparse

from servolink.cli.fleet import add_broker, fleet_of
from servolink.cli.main import FAILED, OK
from servolink.cli.output import Table, counted, print_json, print_table, print_text
from servolink.cli.session import Interruption, run_interruptible


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink fleet doctor`."""
    parser.set_defaults(run=run)
    add_broker(parser)


def run(args: argparse.Namespace) -> int:
    """Examine the fleet; return 0 if nothing is wrong, else 1."""

    async def main(interruption: Interruption) -> int:
        async with fleet_of(args) as fleet:
            findings = await fleet.doctor()
            online, known = len(fleet.controller.roster.online), len(fleet.controller.roster)
        if args.json:
            found = [{"about": one.about, "observation": one.observation, "remedy": one.remedy} for one in findings]
            print_json({"boards": known, "online": online, "findings": found})
        else:
            print_text(f"the broker answers; {online} of {counted(known, 'board')} connected")
            for number, one in enumerate(findings, 1):
                print_text("")
                print_text(f"{number}. {one.about}", "bold")
                print_table(Table((), [("observation", one.observation), ("remedy", one.remedy)]))
            if not findings:
                print_text("nothing is wrong")
        return FAILED if findings else OK

    return run_interruptible(main, "nothing was changed")
