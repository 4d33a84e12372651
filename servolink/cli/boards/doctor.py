"""`servolink doctor`: why a board does not work."""

from __future__ import annotations

import argparse
import asyncio
from dataclasses import asdict
from typing import Any

import msgspec

from servolink.cli.arguments import SERVO_NAME, not_empty
from servolink.cli.command import FIRST_STEPS, Command, flag, group, option
from servolink.cli.command_session import Interruption, run_interruptible
from servolink.cli.screen.output import Table, print_json, print_table, print_text
from servolink.cli.usage import usage_error
from servolink.discovery.resolving import resolve_url
from servolink.discovery.search import search
from servolink.doctor.examine import Report, examine
from servolink.doctor.permissions import rules
from servolink.doctor.system import ListedUsbDevice, SystemFacts, named_usb_device, usb_device
from servolink.errors import OpenError
from servolink.script import FAILED, NO_BOARD, OK

_PERCENTILES = (50, 90, 99)
_FOR_LEARNING = ("write", "clear", "servo", "power_cycled", "yes")


_LEARNING = (
    group(
        "learning a board that has a name (see `servolink use`)",
        flag("--learn", "measure what boards do differently, and keep it under the board's name"),
        flag("--power-cycled", "the board was just switched off and on, so do not ask for that"),
        flag("--write", "also store records on the board; a backup is made, and restored"),
        flag("--clear", "with --write: also delete the whole content once, then restore the content"),
        option("--servo", "SERVO", "also move this servo (id or caption) a little, and time it", SERVO_NAME),
        flag("--yes", "do not ask"),
    ),
)


@Command(
    "doctor",
    FIRST_STEPS,
    help="find out why a board does not work, and learn what it does",
    examples=("doctor", "doctor virtual://"),
    options=(
        option("board", "BOARD", "address or name of the board (the only one here)", not_empty, nargs="?"),
        flag("--print-udev", "print udev rules that allow you to use the board on Linux, and exit"),
        *_LEARNING,
    ),
    patience="about 0.5",
)
def run(args: argparse.Namespace) -> int:
    """Examine the board and this computer and report, or learn the board, or print udev rules."""
    if args.learn:
        from servolink.cli.boards import learn  # late: it needs far more than the rest

        return learn.run(args)
    if given := [name for name in _FOR_LEARNING if getattr(args, name) not in (False, None)]:
        usage_error(args, f"--{given[0].replace('_', '-')} needs --learn")
    facts = SystemFacts()
    board = args.board or args.url
    if args.print_udev:
        print(rules(facts, _devices(facts, board)), end="")
        return OK

    async def main(interruption: Interruption) -> int:
        report = await examine(facts, board, args.byte_order, args.timeout)
        if args.json:
            print_json(described(report))
        else:
            print_report(report)
        return NO_BOARD if report.is_absent else FAILED if report.findings else OK

    return run_interruptible(main, "nothing was changed")


def _devices(facts: SystemFacts, board: str | None) -> list[ListedUsbDevice]:
    """Return the USB devices to write rules for. Raise OpenError if there are none."""
    urls = [asyncio.run(resolve_url(board))] if board else [candidate.url for candidate in search()]
    found = [device for url in urls if (device := usb_device(facts, url) or named_usb_device(url)) is not None]
    if not found:
        raise OpenError(
            "no board was found on USB to write rules for; plug the board in, or name one: "
            "servolink doctor --print-udev usb://VID:PID"
        )
    return found


def described(report: Report) -> dict[str, Any]:
    """Return an examination for `--json`."""
    return {
        "boards": msgspec.to_builtins(report.candidates),
        "examined": report.urls,
        "response": report.response and asdict(report.response),
        "unsupported": list(report.unsupported),
        "is_proved": report.is_proved,
        "line": report.line
        and {
            "received_bytes": report.line.received_bytes,
            "noise_bytes": report.line.noise_bytes,
            "requests": report.line.requests,
            "unanswered": report.line.unanswered,
            "late": report.line.late,
            "repeated": report.line.repeated,
            "round_trip_seconds": {f"p{percent}": report.line.percentile(percent) for percent in _PERCENTILES},
        },
        "findings": [asdict(finding) for finding in report.findings],
    }


def print_report(report: Report) -> None:
    """Print an examination: the facts, then each finding with its remedy."""
    print_table(Table((), list(_facts(report))))
    for number, finding in enumerate(report.findings, 1):
        print_text("")
        print_text(f"{number}. {finding.check}", "bold")
        print_table(
            Table((), [("observation", finding.observation), ("meaning", finding.meaning), *_steps(finding.remedy)])
        )
    if not report.findings:
        print_text("nothing is wrong")


def _facts(report: Report) -> list[tuple[str, str]]:
    facts = [("examined", ", ".join(report.urls) or "nothing: no board was found")]
    if response := report.response:
        project = f"project id {'unknown' if response.project_id is None else response.project_id or 'none'}"
        facts.append(("response", f"{project}, {response.byte_order} byte order, {response.seconds * 1000:.1f} ms"))
    if report.unsupported:
        facts.append(("not answered", ", ".join(report.unsupported)))
    if not report.is_proved:
        facts.append(("opening", "fewer than 3 kinds of short queries are answered, so it waits for a quiet line"))
    if line := report.line:
        facts.append(("noise", f"{line.noise_bytes} of {line.received_bytes} bytes"))
        times = [f"p{percent} {time * 1000:.1f} ms" for percent in _PERCENTILES if (time := line.percentile(percent))]
        facts.append(("round trips", ", ".join(times)))
    return facts


def _steps(remedy: str) -> list[tuple[str, str]]:
    return [("" if number else "remedy", step) for number, step in enumerate(remedy.splitlines())]
