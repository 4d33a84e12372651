"""`servolink spy`: show the traffic of another program with a board, and report the findings about the board."""

from __future__ import annotations

import argparse
import asyncio
import shutil
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

from servolink.boards import resolve_url
from servolink.cli.arguments import listening, new_file, not_empty, whole_number
from servolink.cli.command import DEVELOPERS, Command, flag, one_of, option
from servolink.cli.developers.packets import lines_for
from servolink.cli.recordings.record_view import RecordingEnded, summary
from servolink.cli.screen.output import Table, cut, is_terminal, print_error, text_width
from servolink.cli.screen.result import CommandResult, Part, Remark, show, show_served
from servolink.cli.screen.terminal import end_process
from servolink.cli.usage import usage_error
from servolink.doctor import Learner, Passed, Relay, Watcher, verdict
from servolink.errors import ConnectionLost, escape
from servolink.protocol import packet_to_json
from servolink.recorder import Direction, LateRecording
from servolink.support import ExitCode, Signals
from servolink.transports import NetworkPlace, SerialTransport, StreamTransport, create

_PATIENCE = 2.0  # seconds, at the end, to decode the backlog
_SWITCH = 0.0002  # seconds for which the watching thread may delay the relay


class SpyReport(CommandResult, frozen=True):
    """JSON of the last line of `spy`: facts by name, number of bytes passed on unread, and recording."""

    learnt: dict[str, Any]
    overlooked: int
    recording: RecordingEnded | None


@Command(
    "spy",
    DEVELOPERS,
    help="look on while another program uses a board, and learn from it",
    details="It stands between a board and any other program, passes every byte on unchanged, shows the packets in "
    "them, and says at the end what they tell about the board. Nothing else is sent.\n\n"
    "Ctrl-C is its normal end, with exit code 0.",
    examples=("spy /dev/ttyACM0 --pty /tmp/board", "spy COM3 --tcp 127.0.0.1:7878 --record out.mcap"),
    options=(
        option("port", "PORT", "serial port or TCP address of the board", not_empty),
        one_of(
            option(
                "--pty",
                "LINK",
                "make a serial port for the program, and link to it at LINK (the default)",
                nargs="?",
                const="",
            ),
            option("--tcp", "HOST:PORT", "serve the program over TCP instead", listening),
        ),
        option(
            "--baudrate",
            "N",
            "of the board's port (with --pty the one that the program sets, 115200 at first)",
            whole_number(50, 12_000_000),
        ),
        option("--record", "FILE", "record to a new file, such as out.mcap", new_file),
        flag("--quiet", "show no packets, only what was learnt"),
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Relay traffic until Ctrl-C or the loss of the board."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH)
    try:
        return asyncio.run(_spy(args))
    finally:
        sys.setswitchinterval(before)


async def _spy(args: argparse.Namespace) -> int:
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    board = await _board(args)
    encoding = args.caption_encoding or "utf-8"
    recording = LateRecording(args.record, board.url, encoding, loop.time) if args.record else None
    learner = Learner(encoding)
    watcher = Watcher(learner, _shown(args, learner, recording))

    def tap(seconds: float, direction: Direction, data: bytes) -> None:
        if recording is not None:
            recording.take(seconds, direction, data)
        watcher.take(seconds, direction, data)

    def told(is_there: bool) -> None:  # noqa: FBT001 - a callback
        print_error(f"servolink: a program has {'connected' if is_there else 'gone'}")

    relay = Relay(board, tap, told)
    is_open, error = False, None
    with Signals.ENDING.handled(stop.set, again=lambda: end_process(ExitCode.OK)):
        try:
            async with AsyncExitStack() as stack:
                stack.push_async_callback(relay.close)
                await relay.open()
                is_open = True
                url = await stack.enter_async_context(_program_side(args, relay, board))
                show_served(listening=url)
                if url.startswith("tcp://"):
                    reached_by = NetworkPlace.parse(url.removeprefix("tcp://")).reached_by
                    print_error(f"servolink: {url} is open to {reached_by}")
                error = await _until(stop, relay)
        finally:
            await asyncio.to_thread(watcher.end, _PATIENCE)
            if is_open:
                await _report(learner, recording, overlooked=watcher.overlooked)
    if watcher.failure is not None:
        raise watcher.failure
    if error is not None:
        raise error
    return ExitCode.OK


async def _board(args: argparse.Namespace) -> StreamTransport:
    """Return the transport to the board, not opened yet."""
    board = create(await resolve_url(args.port, through_hub=False))
    if not isinstance(board, StreamTransport):
        usage_error(args, f"argument PORT: {board.url} is neither a serial port nor tcp://HOST:PORT")
    if args.baudrate is not None:
        if not isinstance(board, SerialTransport):
            usage_error(args, f"argument --baudrate: {board.url} has none")
        board.set_baudrate(args.baudrate)
    return board


@asynccontextmanager
async def _program_side(args: argparse.Namespace, relay: Relay, board: StreamTransport) -> AsyncIterator[str]:
    """Make the place where the program connects; yield its URL."""
    if args.tcp:
        async with relay.on_network(*NetworkPlace.parse(args.tcp)) as url:
            yield url
    else:
        follow = partial(_follow, args, board)
        with relay.on_terminal(args.pty or None, board.baudrate or 115_200, follow) as url:
            yield url


def _follow(args: argparse.Namespace, board: StreamTransport, baudrate: int) -> None:
    """Set the board's port to the baud rate set by the program on the pseudo-terminal."""
    if args.baudrate is not None:
        return
    if board.set_baudrate(baudrate):
        print_error(f"servolink: the program has set {baudrate} baud, and so has the board's port now")
    else:
        print_error(f"servolink: the program has set {baudrate} baud, which the board's port cannot have")


def _shown(args: argparse.Namespace, learner: Learner, recording: LateRecording | None) -> Callable[[Passed], None]:
    """Return the handler of each packet, for the observing thread."""
    lines = PacketPrinter()

    def seen(passed: Passed) -> None:
        if recording is not None and not recording.has_begun and (order := args.byte_order or learner.byte_order):
            recording.begin(order)
        if not args.quiet:
            lines.show(passed)

    return seen


async def _until(stop: asyncio.Event, relay: Relay) -> ConnectionLost | None:
    """Return when `stop` is set, or with the cause when the board is gone."""
    stopped, lost = asyncio.ensure_future(stop.wait()), asyncio.ensure_future(relay.until_lost())
    try:
        await asyncio.wait((stopped, lost), return_when=asyncio.FIRST_COMPLETED)
    finally:
        stopped.cancel()
        lost.cancel()
    return lost.result() if lost.done() and not lost.cancelled() else None


async def _report(learner: Learner, recording: LateRecording | None, *, overlooked: int) -> None:
    """Print the findings, and write the findings at the end of the recording."""
    facts = verdict(learner)
    status = None
    if recording is not None and learner.size:
        status = await recording.end("; ".join(f"{fact.name}: {fact.text}" for fact in facts))
    table = Table((), [(fact.name.replace("_", " "), fact.text) for fact in facts], "what was learnt")
    text: list[Part] = ["", table]
    if overlooked:
        text.append(Remark(f"{overlooked:,} bytes were passed on but not looked at: the output was too slow"))
    if status is not None:
        text.append(summary(status, is_ring=False))
    learnt = {fact.name: fact.value for fact in facts}
    show(SpyReport(learnt, overlooked, None if status is None else RecordingEnded.of(status)), text)


_WHO = {"sent": "program", "received": "board"}
_LONGEST = 400  # characters of a line where nothing limits it
_SHOWN = 16  # bytes of anything but a packet


class PacketPrinter:
    """Printer of relayed packets, in order."""

    def __init__(self) -> None:
        self._start: float | None = None

    def show(self, passed: Passed) -> None:
        """Print a line, or with JSON an object."""
        if self._start is None:
            self._start = passed.seconds
        seconds = passed.seconds - self._start
        who = _WHO[passed.direction]
        line = f"{seconds:9.3f}  {who:7}  {_text(passed)}"
        text = shortened(escape(line), shutil.get_terminal_size().columns if is_terminal() else _LONGEST)
        show({"seconds": round(seconds, 6), "from": who, **_described(passed)}, text)


def _described(passed: Passed) -> dict[str, Any]:
    """Return a relayed packet, or undecodable bytes, as a JSON object."""
    seen = passed.seen
    if passed.packet is not None:
        return {**packet_to_json(passed.packet), "byte_order": seen.byte_order}
    if seen.kind == "noise":
        return {"kind": "noise", "bytes": seen.data.hex()}
    kind = "undecodable" if seen.kind == "packet" else seen.kind
    return {"kind": kind, "id": seen.packet_id, "byte_order": seen.byte_order, "bytes": seen.data.hex()}


def _text(passed: Passed) -> str:
    seen = passed.seen
    if passed.packet is not None:
        return lines_for(packet_to_json(passed.packet))[0]
    shown = seen.data[:_SHOWN].hex() + ("..." if len(seen.data) > _SHOWN else "")
    if seen.kind == "noise":
        return f"{len(seen.data)} bytes outside of frames: {shown}"
    if seen.kind == "damaged":
        return f"packet {seen.packet_id} with a wrong checksum: {shown}"
    if seen.kind == "packet":
        return f"packet {seen.packet_id} whose content contradicts itself: {shown}"
    return f"unknown packet {seen.packet_id} ({seen.byte_order}), {len(seen.content)} bytes: {shown}"


def shortened(line: str, columns: int) -> str:
    """Return a line that fits into so many columns, with dots in place of its end."""
    return line if text_width(line) <= columns else f"{cut(line, columns - 3)}..."
