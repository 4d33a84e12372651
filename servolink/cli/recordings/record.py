"""`servolink record`: what happens on a board, in a file for people, tools and bug reports."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial

from servolink.cli.arguments import alarm, new_file, number
from servolink.cli.command import RECORDINGS, Command, flag, option
from servolink.cli.command_session import (
    ENDLESS,
    KEEP_MODE,
    Interruption,
    choose_board,
    connection_options,
    mode_restored,
    run_interruptible,
)
from servolink.cli.recordings.record_view import RecordView
from servolink.cli.screen.live import can_draw
from servolink.cli.screen.output import counted
from servolink.cli.screen.result import CommandResult, Ending, Remark, Returned, print_for_people, show
from servolink.cli.screen.terminal import single_keys
from servolink.client import Alarm
from servolink.errors import ServolinkError
from servolink.recorder import Recorder, Wanted, record_at, repair
from servolink.support import ExitCode, Signals

_MOST_HZ = 200.0
_UNITS = {"s": (1, "seconds"), "m": (60, "minutes"), "h": (3600, "hours")}
_LONGEST_RING = 86400


def _duration(text: str) -> float:
    """Return the seconds in a text such as `90`, `30s`, `5m` or `1h`."""
    unit, name = _UNITS.get(text[-1:], (1, "seconds"))
    return number(1, _LONGEST_RING / unit, name)(text[:-1] if text[-1:] in _UNITS else text) * unit


@Command(
    "record",
    RECORDINGS,
    help="record what happens on a board, beside other programs too",
    details=f"{ENDLESS}",
    examples=(
        "record out.mcap --seconds 2",
        "record out.mcap --hz 50 --seconds 1 --json",
        "record out.mcap --seconds 1 --wire",
    ),
    options=(
        option("file", "FILE", "a new file, such as out.mcap", new_file),
        option("--seconds", "N", "end after N seconds", number(0.001, 10**9, "seconds")),
        option(
            "--hz",
            "N",
            "read the servos N times a second (20); 0 sends nothing to the board",
            number(0.0, _MOST_HZ, "readings a second"),
            default=20.0,
        ),
        option(
            "--ring",
            "TIME",
            "keep only the last TIME, such as 5m, in memory; write it when something fails, for SIGUSR1 or key w",
            _duration,
        ),
        flag("--wire", "record only the bytes on the line, and send nothing"),
        option(
            "--alarm",
            "RULE",
            "note when a servo has such a value, as 'temperature_raw>300'; may be repeated",
            alarm,
            action="append",
            default=[],
        ),
        KEEP_MODE,
        flag("--repair", "record nothing, but mend FILE if its end is missing, as after a crash"),
    ),
)
def run(args: argparse.Namespace) -> Ending:
    """Record until the time is over, until `q` is pressed or until Ctrl-C; or mend a file."""
    if args.repair:
        return _repair(args)
    return run_interruptible(partial(_record, args), "nothing was recorded", usage=args)


def _repair(args: argparse.Namespace) -> Returned:
    """Repair a recording, and print counts and remarks about the repair."""
    done = repair(args.file)
    text = f"{args.file} is whole, with {counted(done.messages, 'message')}; nothing was changed"
    if done.original:
        text = f"repaired {args.file}: {counted(done.messages, 'message')}; the file as it was is {done.original}"
    value = RecordingRepaired(done.messages, done.original or None, done.remarks)
    return Returned(value, [text, *(Remark(f"{args.file}: {remark}") for remark in done.remarks)])


class RecordingRepaired(CommandResult, frozen=True):
    """JSON of `record` with --repair; `original` is the damaged file, null for a whole one."""

    messages: int
    original: str | None
    remarks: Sequence[str]


class RecordingBegun(CommandResult, frozen=True):
    """JSON of the first line of `record`: the file."""

    recording: str


async def _record(args: argparse.Namespace, interruption: Interruption) -> int:
    alarms = tuple(map(Alarm.parse, args.alarm))
    wanted = Wanted(args.file, args.hz, wire_only=args.wire, alarms=alarms, ring=args.ring)
    around = partial(mode_restored, keeps_mode=args.keep_mode)
    view: RecordView | None = None
    try:
        async with record_at(choose_board(args), wanted, around=around, **connection_options(args)) as recorder:
            view = RecordView(recorder, on_screen=can_draw())
            text = f"recording to {wanted.path}"
            if wanted.ring is not None:
                text = f"keeping the last {wanted.ring:g} s, and writing them when something fails"
            show(RecordingBegun(str(wanted.path)), Remark(text))
            if args.seconds is None:
                interruption.code = ExitCode.OK
            try:
                await _until_the_end(recorder, view, args.seconds)
            finally:
                interruption.state = view.unfinished()  # for a second Ctrl-C, while the end is written
    finally:
        if view is not None:
            interruption.state = view.end()
    if recorder.over.is_set():
        raise ServolinkError(f"the hub has ended; {interruption.state}")
    print_for_people(interruption.state)
    return ExitCode.OK


async def _until_the_end(recorder: Recorder, view: RecordView, seconds: float | None) -> None:
    """Wait for the end of the time, the key `q`, or the end of the recorder."""
    ending = asyncio.Event()
    marks = 0

    def typed(keys: str) -> None:
        nonlocal marks
        for key in keys.lower():
            if key == "q":
                ending.set()
            elif key == "w":
                recorder.save("asked for by a key")
            elif key == "m":
                marks += 1
                recorder.mark(f"mark {marks}", who="keyboard")

    def save() -> None:
        recorder.save("asked for by a signal")

    work = (view.run(), ending.wait(), recorder.over.wait())
    tasks: list[asyncio.Task[object]] = [asyncio.create_task(each) for each in work]
    saving = nullcontext() if recorder.wanted.ring is None else Signals.SAVING.handled(save)
    with saving, single_keys(typed):
        try:
            await asyncio.wait(tasks[1:], timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
