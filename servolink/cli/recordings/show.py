"""`servolink show`: what happened in a recording."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from difflib import get_close_matches
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from servolink.cli.arguments import SERVO_ID, not_empty, number
from servolink.cli.command import RECORDINGS, Command, flag, group, option
from servolink.cli.screen.output import Table, console, counted, is_terminal, sized, text_width
from servolink.cli.screen.result import CommandResult, Part, Remark, Text, show, show_all
from servolink.cli.usage import usage_error
from servolink.errors import escape, quote
from servolink.protocol import PACKETS
from servolink.recorder import (
    CHANNELS,
    BugReport,
    Recorded,
    Recording,
    Selection,
    Story,
    StoryRow,
    Summary,
    base_name,
    duration,
)
from servolink.support import ExitCode

SECONDS = number(0, 10**9, "seconds")
CHANNEL_NAMES = tuple(topic.removeprefix("/") for topic in CHANNELS)
_PERCENTILES = (50, 99)
_WHO = 10  # columns


def _packet(text: str) -> str:
    """Return the name of a packet. Refuse an unknown name, and suggest similar names."""
    known = {base_name(name): name for name in PACKETS.by_name}
    if base_name(text) not in known:
        alike = get_close_matches(base_name(text), known, 1)
        hint = f"; did you mean {known[alike[0]].removesuffix('Response')}?" if alike else ""
        raise argparse.ArgumentTypeError(f"no packet is called {quote(text)}{hint}")
    return text


SELECTION = (
    group(
        "part of the recording",
        option("--from", "SECONDS", "from this second on", SECONDS, dest="since"),
        option("--to", "SECONDS", "up to this second", SECONDS, dest="until"),
        option(
            "--channel",
            "NAME",
            f"only this channel, which may be given several times: {', '.join(CHANNEL_NAMES)}",
            action="append",
            choices=CHANNEL_NAMES,
            default=[],
        ),
        option("--packet", "NAME", "limit packets to this name", _packet),
        option("--servo", "ID", "limit messages to this servo", SERVO_ID),
        flag("--problems", "only what went wrong"),
    ),
)


def selection(args: argparse.Namespace) -> Selection:
    """Return what `args` selects."""
    if args.since is not None and args.until is not None and args.since > args.until:
        usage_error(args, f"--from {args.since:g} is after --to {args.until:g}")
    topics = frozenset(f"/{name}" for name in args.channel)
    return Selection(args.since, args.until, topics, args.packet or "", args.servo, args.problems)


@Command(
    "show",
    RECORDINGS,
    help="tell what happened in a recording, and what went wrong",
    examples=("show out.mcap", "show out.mcap --problems", "show out.mcap --from 2 --to 5 --servo 3 --json"),
    options=(option("file", "FILE", "a recording, or a report", not_empty), *SELECTION),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Tell the story of a recording, or print its messages as JSON."""
    wanted, path = selection(args), Path(args.file)
    if BugReport.is_in(path):
        _show_report(path, wanted)
    else:
        _show(path, wanted)
    return ExitCode.OK


class ReportShown(CommandResult, frozen=True):
    """JSON of the first line of `show` for a report: facts, and sizes of the files inside in bytes."""

    report: Mapping[str, Any]
    files: dict[str, int]


class RecordingShown(CommandResult, frozen=True):
    """JSON of the line of `show` about a recording; null for a recording of unknown origin."""

    recording: Recorded | None


class MessageShown(CommandResult, frozen=True):
    """JSON of each message of `show`: seconds since the start, nanoseconds since 1970, and its content."""

    seconds: float
    time: int
    channel: str
    message: Any


class SummaryShown(CommandResult, frozen=True):
    """JSON of the last line of `show`: the figures of all messages."""

    summary: dict[str, Any]


def _show(path: Path, wanted: Selection) -> None:
    recording = Recording(path)
    show_all(_messages(recording, wanted), _story(recording, wanted))


def _show_report(path: Path, wanted: Selection) -> None:
    """Print the facts of a report, and tell its recording."""
    report = BugReport.read(path)
    files = report.files
    sizes = {name: len(content) for name, content in files.items()}
    table = Table(("file", "bytes"), [*sizes.items()])
    show(ReportShown(report.facts, sizes), [table, *json.dumps(report.facts, indent=1).splitlines(), ""])
    if BugReport.RECORDING in files:
        with TemporaryDirectory(prefix="servolink-") as folder:
            unpacked = Path(folder) / BugReport.RECORDING
            unpacked.write_bytes(files[BugReport.RECORDING])
            _show(unpacked, wanted)


def _messages(recording: Recording, wanted: Selection) -> Iterator[CommandResult]:
    """Yield what was recorded, each message, and the figures."""
    yield RecordingShown(recording.about)
    summary = Summary()
    for entry in summary.over(recording.entries(wanted)):
        yield MessageShown(round(entry.seconds, 6), entry.time, entry.topic, entry.message)
    yield SummaryShown({**summary.as_dict(), "remarks": recording.remarks})


def _story(recording: Recording, wanted: Selection) -> Iterator[Text]:
    """Yield the story and its figures."""
    yield from (Table((), list(_head(recording))), "")
    # Missing messages show failures too, so the story needs every message.
    summary = Summary()
    entries = summary.over(recording.entries(msgspec.structs.replace(wanted, only_problems=False)))
    is_all = not wanted.packet and wanted.servo_id is None
    story = Story(hz=_hz(recording.about), packets=_tells_packets(recording.about, wanted), silences=is_all)
    for line in story.tell(entries):
        if line.is_problem or not wanted.only_problems:
            yield _lines(line)
    summary.problems.update(story.silences)
    yield _figures(summary)
    yield from (Remark(f"{recording.path}: {remark}") for remark in recording.remarks)


def _hz(about: Recorded | None) -> float:
    """Return how many readings of the servos a second there should be; 0 if that is unknown."""
    try:
        return float(about.hz) if about else 0.0
    except ValueError:
        return 0.0


def _tells_packets(about: Recorded | None, wanted: Selection) -> bool:
    """Return whether the story includes each request: on demand, and where commands are unknown."""
    is_spied = about is not None and about.through == "spy"
    return is_spied or bool(wanted.packet) or "/packets" in wanted.topics


def _head(recording: Recording) -> Iterator[tuple[str, str]]:
    yield "recording", str(recording.path)
    if recording.started:
        started = datetime.fromtimestamp(recording.started / 1e9, UTC)
        yield "from", f"{started:%Y-%m-%d %H:%M:%S} UTC"
    if about := recording.about:
        beside = {"hub": ", beside other programs on its hub", "spy": ", between a program and the board"}
        yield "board", f"{about.board}{beside.get(about.through, '')}"
        yield "written by", f"servolink {about.version}"


def _lines(line: StoryRow) -> Iterator[Part]:
    """Yield a line of the story, on a terminal in as many lines as its width needs."""
    head = f"{line.seconds:10.3f}  {sized(escape(line.who), _WHO)}  "
    text, style = escape(line.text), "bold red" if line.is_problem else ""
    if not is_terminal():
        yield head + text
        return
    from rich.text import Text

    terminal = console()
    for part in Text(text).wrap(terminal, max(20, terminal.width - text_width(head))):
        yield head + part.plain.rstrip(), style
        head = " " * text_width(head)


def _figures(summary: Summary) -> Iterator[Part]:
    for table in (_requests(summary), _servos(summary)):
        if table.rows:
            yield from ("", table)
    yield from ("", Table((), list(_facts(summary))))


def _requests(summary: Summary) -> Table:
    """Return the table of requests, with counts and round trips in milliseconds."""
    rows = [
        (
            name.removesuffix("Request"),
            each.sent,
            each.unanswered,
            *(_milliseconds(each.times.percentile(percent)) for percent in _PERCENTILES),
            _milliseconds(each.times.longest if each.times.count else None),
        )
        for name, each in sorted(summary.requests.items(), key=lambda item: -item[1].sent)
    ]
    return Table(("request", "sent", "unanswered", "p50 ms", "p99 ms", "longest ms"), rows)


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds * 1000, 1)


def _servos(summary: Summary) -> Table:
    rows = [
        (
            *(servo_id, each.caption, *(round(angle, 1) for angle in each.angles)),
            *(each.most_current, each.most_temperature, ", ".join(sorted(each.doubts)) or None),
        )
        for servo_id, each in sorted(summary.servos.items())
    ]
    return Table(("servo", "caption", "lowest", "highest", "most current", "most temperature", "doubts"), rows)


def _facts(summary: Summary) -> Iterator[tuple[str, str]]:
    yield "lasts", duration(summary.seconds)
    yield "messages", ", ".join(f"{topic[1:]} {count}" for topic, count in sorted(summary.messages.items())) or "none"
    if summary.programs:
        yield "commands", ", ".join(f"{who} {count}" for who, count in summary.programs.most_common())
    if summary.noise:
        yield "noise", f"{summary.noise} bytes"
    if summary.missed:
        yield "missed", counted(summary.missed, "reading")
    problems = ", ".join(f"{name} ({count})" for name, count in summary.problems.most_common())
    yield "problems", problems or "none"
