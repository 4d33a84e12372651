"""`servolink doctor`: why a board does not work."""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.resources import files
from typing import Any, Literal

from servolink.boards import resolve_url, search
from servolink.cli.arguments import SERVO_NAME, not_empty
from servolink.cli.boards import learn
from servolink.cli.command import FIRST_STEPS, Command, flag, group, option
from servolink.cli.command_session import Interruption, run_interruptible
from servolink.cli.screen.output import Table
from servolink.cli.screen.result import CommandResult, Ending, Part, Returned
from servolink.cli.usage import usage_error
from servolink.doctor import Finding, ProbeResponse, Report, SystemFacts, examine, rules_for
from servolink.support import ExitCode, read_json
from servolink.transports import DeviceInfo

_PERCENTILES = (50, 90, 99)
_COUNTS = ("received_bytes", "noise_bytes", "requests", "unanswered", "late", "echoes", "repeated")
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
def run(args: argparse.Namespace) -> Ending:
    """Examine the board and this computer and report, or learn the board, or print udev rules."""
    if args.learn:
        return learn.run(args)
    if given := [name for name in _FOR_LEARNING if getattr(args, name) not in (False, None)]:
        usage_error(args, f"--{given[0].replace('_', '-')} needs --learn")
    facts = SystemFacts()
    board = args.board or args.url
    if args.print_udev:
        urls = [asyncio.run(resolve_url(board))] if board else [device.url for device in search()]
        print(rules_for(facts, urls), end="")
        return ExitCode.OK

    async def main(interruption: Interruption) -> Returned:
        report = await examine(facts, board, args.byte_order, args.timeout)
        is_well = all(each.is_harmless for each in report.findings)
        code = ExitCode.NO_BOARD if report.is_absent else ExitCode.OK if is_well else ExitCode.FAILED
        return Returned(Examination(**examined(report)), report_text(report, os.environ), code)

    return run_interruptible(main, "nothing was changed")


class Examination(CommandResult, frozen=True, kw_only=True):
    """JSON of `doctor`. Round trips are in seconds by percentile, such as p50; null without a round trip."""

    boards: list[DeviceInfo]
    examined: list[str]
    response: ProbeResponse | None
    unsupported: tuple[str, ...]
    is_proved: bool
    line: dict[str, int | dict[str, float | None]] | None
    findings: list[Finding]


def examined(report: Report) -> dict[str, Any]:
    """Return the fields of `Examination` by name."""
    line = report.line
    return {
        "boards": report.candidates,
        "examined": report.urls,
        "response": report.response,
        "unsupported": report.unsupported,
        "is_proved": report.is_proved,
        "line": line
        and {
            **{name: getattr(line, name) for name in _COUNTS},
            "round_trip_seconds": {f"p{percent}": line.percentile(percent) for percent in _PERCENTILES},
        },
        "findings": report.findings,
    }


class Speech:
    """Language of a shell, with the texts that the studio has for messages and findings."""

    _VALUE = re.compile(r"\{\w+\}")

    def __init__(self, environment: Mapping[str, str], encoding: str | None = None) -> None:
        """Take the language of `environment`, and English if `encoding`, by default of the output, has no Chinese."""
        name = next((found for each in ("LC_ALL", "LC_MESSAGES", "LANG") if (found := environment.get(each))), "")
        is_chinese = name.startswith("zh") and "中".encode(encoding or sys.stdout.encoding, "ignore") != b""
        self.tag = "en" if not is_chinese else "zh-Hant" if re.search("TW|HK|MO|Hant", name) else "zh-Hans"
        texts = read_json((files("servolink") / f"studio/web/texts/{self.tag}.json").read_text("utf-8"))
        self._findings: Mapping[str, Mapping[str, str]] = texts["findings"]
        messages = {
            english: text
            for place, each in texts["messages"].items()
            if re.search("doctor|transports|line_marks", place)  # a template of others could fit a part of a sentence
            for english, text in each.items()
        }
        self._messages = dict(sorted(messages.items(), key=lambda one: -len(self._VALUE.sub("", one[0]))))

    def said(self, text: str) -> str:
        """Return a message in this language, line by line; a line without a translation stays."""
        return "\n".join(map(self._line, text.split("\n"))) if self._messages else text

    def _line(self, text: str) -> str:
        for english, translation in self._messages.items():
            if (values := _values_in(text, self._VALUE.split(english))) is not None:
                told = dict(zip(self._VALUE.findall(english), map(self._line, values), strict=True))
                if re.search(r"\w", self._VALUE.sub("", english)) or [*told.values()] != values:
                    return re.sub(self._VALUE, lambda found: told[found[0]], translation)  # noqa: B023 - called at once
        return text

    def told(self, finding: Finding, field: Literal["title", "meaning"], english: str) -> str:
        """Return the name of the check or the meaning of a finding; `english` is what Python says."""
        return self._findings.get(finding.check, {}).get(field) or self.said(english)


def _values_in(text: str, literals: list[str]) -> list[str] | None:
    """Return the values between literals, each as short as possible, in linear time; None for another text."""
    first, *between = literals
    last = between.pop() if between else ""
    values, rest = list[str](), text.removeprefix(first)
    for literal in between:
        value, found, rest = rest.partition(literal)
        if not found:
            return None
        values.append(value)
    fits = text.startswith(first) and rest.endswith(last) and (len(literals) > 1 or not rest)
    return [*values, *[rest.removesuffix(last)] * (len(literals) > 1)] if fits else None


def report_text(report: Report, environment: Mapping[str, str], encoding: str | None = None) -> Iterator[Part]:
    """Yield an examination for people, in the language of `Speech`: the facts, then each finding with its remedy."""
    said = (speech := Speech(environment, encoding)).said
    yield Table((), [(said(name), said(fact)) for name, fact in _facts(report)])
    for number, finding in enumerate(report.findings, 1):
        title = speech.told(finding, "title", finding.check)
        name = "" if title == finding.check else f" ({finding.check})"
        yield from ("", (f"{number}. {title}{name}", "bold"))
        observation, meaning = (
            (said("observation"), said(finding.observation)),
            (said("meaning"), speech.told(finding, "meaning", finding.meaning)),
        )
        yield Table((), [observation, meaning, *((said(name), said(step)) for name, step in _steps(finding.remedy))])
    if not report.findings:
        yield said("nothing is wrong")


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
