"""`servolink record`: what happens on a board, in a file for people, tools and bug reports."""

from __future__ import annotations

import argparse
import asyncio
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from servolink.cli.arguments import number
from servolink.cli.main import FAILED, OK, fail, usage_error
from servolink.cli.output import counted, print_error, print_json, print_text
from servolink.cli.session import ENDLESS, Interruption, choose_board, run_interruptible
from servolink.cli.terminal import single_keys
from servolink.errors import RecordingError

if TYPE_CHECKING:  # and imported late: `--help` needs none of it
    from servolink.recorder.recorder import Recorder
    from servolink.recorder.writer import RecorderStatus

_MOST_HZ = 200.0


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink record`."""
    parser.set_defaults(run=run)
    parser.description = f"{parser.description}\n\n{ENDLESS}"
    parser.add_argument("file", type=Path, metavar="FILE", help="a new file, such as out.mcap")
    parser.add_argument("--seconds", type=number(0.001, 10**9, "seconds"), metavar="N", help="end after N seconds")
    parser.add_argument(
        "--hz",
        type=number(0.0, _MOST_HZ, "readings a second"),
        default=20.0,
        metavar="N",
        help="read the servos N times a second (20); 0 sends nothing to the board",
    )
    parser.add_argument("--wire", action="store_true", help="record only the bytes on the line, and send nothing")
    parser.add_argument(
        "--alarm",
        type=_alarm,
        action="append",
        default=[],
        metavar="RULE",
        help="note when a servo has such a value, as 'temperature_raw>300'; may be repeated",
    )


def _alarm(text: str) -> str:
    """Return `text` if it describes an alarm."""
    from servolink.client.alarms import Alarm

    try:
        Alarm.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


def run(args: argparse.Namespace) -> int:
    """Record until the time is over, until `q` is pressed or until Ctrl-C."""

    async def main(interruption: Interruption) -> int:
        return await _record(args, interruption)

    try:
        return run_interruptible(main, "nothing was recorded")
    except RecordingError:
        raise
    except ValueError as error:
        usage_error(args, str(error))


async def _record(args: argparse.Namespace, interruption: Interruption) -> int:
    from servolink.client.alarms import Alarm
    from servolink.recorder.recorder import Wanted, record_at

    alarms = tuple(map(Alarm.parse, args.alarm))
    wanted = Wanted(args.file, args.hz, wire_only=args.wire, alarms=alarms)
    options = {"byte_order": args.byte_order, "caption_encoding": args.caption_encoding, "patience": args.timeout}
    recorder: Recorder | None = None
    try:
        async with record_at(choose_board(args), wanted, **options) as recorder:
            _print_start(recorder, as_json=args.json)
            if args.seconds is None:
                interruption.code = OK
            await _until_the_end(recorder, args)
    finally:
        if recorder is not None:
            status = recorder.status
            interruption.state = summary(status)
            if args.json:
                print_json(status_json(status))
    if recorder.over.is_set():
        return fail(f"the hub has ended; {summary(status)}", FAILED)
    if not args.json:
        print_text(summary(status))
    return OK


async def _until_the_end(recorder: Recorder, args: argparse.Namespace) -> None:
    """Return when the time is over, when `q` is pressed, or when nothing more can come."""
    from servolink.cli.live import can_draw
    from servolink.cli.record_view import status_lines

    ending = asyncio.Event()
    marks = 0

    def typed(keys: str) -> None:
        nonlocal marks
        for key in keys.lower():
            if key == "q":
                ending.set()
            elif key == "m":
                marks += 1
                recorder.mark(f"mark {marks}", who="keyboard")

    waiting: list[asyncio.Task[object]] = [asyncio.create_task(event.wait()) for event in (ending, recorder.over)]
    with ExitStack() as stack:
        stack.enter_context(single_keys(typed))
        if not args.json and can_draw():
            waiting.append(asyncio.create_task(status_lines(recorder)))
        try:
            await asyncio.wait(waiting, timeout=args.seconds, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in waiting:
                task.cancel()
            with suppress(asyncio.CancelledError):
                await asyncio.wait(waiting)


def _print_start(recorder: Recorder, *, as_json: bool) -> None:
    if as_json:
        print_json({"recording": str(recorder.wanted.path)})
    else:
        print_error(f"servolink: recording to {recorder.wanted.path}")


def summary(status: RecorderStatus) -> str:
    """Return in a sentence what was recorded."""
    text = f"recorded {counted(status.messages, 'message')} in {status.seconds:.1f} s to {status.path}"
    if status.dropped:
        text += f"; {counted(status.dropped, 'message')} missing, because the disk was too slow or full"
    return text


def status_json(status: RecorderStatus) -> dict[str, object]:
    """Return what was recorded, for programs."""
    return {
        "path": status.path,
        "seconds": round(status.seconds, 3),
        "size_bytes": status.size,
        "messages": status.messages,
        "dropped": status.dropped,
    }
