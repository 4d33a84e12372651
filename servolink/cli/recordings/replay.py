"""`servolink replay`: the board of a recording for other programs, or its commands on a virtual robot."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from servolink.cli.arguments import listening, not_empty, number
from servolink.cli.command import RECORDINGS, Command, flag, option
from servolink.cli.command_session import Interruption, interruptible, run_interruptible
from servolink.cli.screen.live import Line, can_draw, pictures
from servolink.cli.screen.output import Table, counted
from servolink.cli.screen.result import CommandResult, Ending, Part, Remark, Returned, print_for_people, show_served
from servolink.cli.screen.servo_picture import LEGEND, picture_of_servos, wrapped
from servolink.cli.screen.virtual_view import servos_of
from servolink.cli.usage import usage_error
from servolink.errors import escape, quote
from servolink.protocol import (
    MAGIC,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    encode_frame,
    packet_to_json,
)
from servolink.recorder import Asked, RecordedBoardTransport, Recording, ServosRead, duration, read_conversation
from servolink.recorder import asked as in_words
from servolink.support import ExitCode, PseudoTerminal
from servolink.transports import NetworkPlace, Transport, serve_network, serve_terminal
from servolink.virtual import VirtualBoard, load_state, to_degrees

_VIRTUAL = "virtual"


@Command(
    "replay",
    RECORDINGS,
    help="be the board of a recording, or move a virtual robot",
    details="Without --to, programs connect to the recorded board, until Ctrl-C, its normal end.\n"
    "It answers as it did, as long as a program sends the same commands.",
    examples=("replay out.mcap --to virtual --speed 2", "replay out.mcap", "replay out.mcap --tcp 127.0.0.1:7878"),
    options=(
        option("file", "FILE", "a recording", not_empty),
        option("--to", _VIRTUAL, "play the commands on a virtual board", not_empty),
        option("--speed", "N", "play N times as fast (1)", number(0.01, 1000, "times"), default=1.0),
        option("--state", "FILE", "with --to: what the virtual board stores (see `virtual --state`)", not_empty),
        flag("--pty", "serve a pseudo-terminal (the default without --tcp)"),
        option("--tcp", "HOST:PORT", "serve TCP; port 0 takes a free one", listening),
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> Ending:
    """Play the commands on a virtual board, or serve the recorded board until Ctrl-C."""
    if args.to is None:
        if args.state:
            usage_error(args, "--state needs --to virtual")
        return _serve(args)
    if args.to.partition(":")[0] != _VIRTUAL:
        usage_error(
            args,
            f"--to must be virtual, not {quote(args.to)}: nobody knows what stands around a real robot now, so a "
            "recording is never played on one",
        )
    if args.to not in (_VIRTUAL, f"{_VIRTUAL}://") or args.pty or args.tcp:
        usage_error(args, "--to virtual plays on a private board, closed to other programs and without options")

    return play(args)


def _serve(args: argparse.Namespace) -> int:
    read_conversation(Recording(args.file))  # now, so that a damaged file is reported before a program connects

    def connect() -> Transport:
        return RecordedBoardTransport(args.file, speed=args.speed)

    async def main(interruption: Interruption) -> int:
        interruption.code = ExitCode.OK
        pty = args.pty or (PseudoTerminal.AVAILABLE and not args.tcp)
        tcp = args.tcp or (None if pty else "127.0.0.1:0")
        async with AsyncExitStack() as stack:
            urls = [await stack.enter_async_context(serve_terminal(connect))] if pty else []
            if tcp:
                served = serve_network(connect, *NetworkPlace.parse(tcp), begins_with=MAGIC)
                urls.append(await stack.enter_async_context(served))
            for url in urls:
                show_served(listening=url)
            await asyncio.Event().wait()
        return ExitCode.OK

    return run_interruptible(main, "the recorded board is gone")


_EVERY = 0.1  # seconds between two pictures
_SETTLE = 60.0  # seconds after the last command; a macro may go on for ever
_STORED = (ExecuteActionExRequest, ExecuteMacroRequest)
_USUAL_SERVOS = 16


class RecordingPlayed(CommandResult, frozen=True):
    """JSON of `replay` with --to: the commands, and the angles of the servos by id, at the end."""

    played: int
    seconds: float
    angles: dict[int, float]


@dataclass
class Replay:
    """A recording on its way to a virtual board."""

    path: str
    board: VirtualBoard
    commands: Sequence[Asked]
    speed: float
    done: int = 0
    seconds: float = 0.0
    """Of the recording."""
    latest: str = ""

    @property
    def length(self) -> float:
        """When the last command comes, in seconds."""
        return self.commands[-1].seconds if self.commands else 0.0


@interruptible("the recording was not played to its end; it was a virtual robot")
async def play(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Play the recording of `args` on a new virtual board."""
    replay = _load(args)
    with _shown(replay) as tell:
        await _play(replay, tell)
    played = RecordingPlayed(replay.done, round(replay.seconds, 3), _angles(replay.board))
    return Returned(played, _text(replay))


def _load(args: argparse.Namespace) -> Replay:
    recording = Recording(args.file)
    conversation = read_conversation(recording)
    sent = [asked for asked in conversation.commands() if asked.packet is not None]
    first = next((entry.message for entry in recording.messages(ServosRead) if entry.message.servos), None)
    board = VirtualBoard(_servo_count(sent, first), codec=recording.codec)
    if args.state:
        load_state(board, Path(args.state))
    for state in first.servos if first else ():
        if state.servo_id in board.servos:
            angle = to_degrees(round(state.angle)) if state.angle_unit == "adc" else state.angle
            board.servos[state.servo_id].angle = max(-180.0, min(180.0, angle))
    return Replay(args.file, board, sent, args.speed)


def _servo_count(sent: Sequence[Asked], first: ServosRead | None) -> int:
    """Return how many servos the recorded board seems to have; their ids begin with 1."""
    moved = (
        step.servo_id for each in sent if isinstance(each.packet, ExecuteActionRequest) for step in each.packet.steps
    )
    seen = (state.servo_id for state in (first.servos if first else ()))
    highest = max((servo_id for servo_id in (*moved, *seen) if 0 < servo_id <= VirtualBoard.MAX_SERVOS), default=0)
    return highest or _USUAL_SERVOS


async def _play(replay: Replay, tell: Callable[[Asked | None], None]) -> None:
    """Pass each command to the board at its time, and continue until all servos rest.

    The board has no clock of its own, so that at twice the speed it is told that twice the time has passed.
    """
    loop = asyncio.get_running_loop()
    start = loop.time()
    host = replay.board.attach(lambda data: None)
    for each in replay.commands:
        await _until(replay, tell, start, each.seconds)
        replay.done += 1
        host.receive(encode_frame(*each.frame, replay.board.codec.byte_order), start + replay.seconds)
        tell(each)
    end = replay.seconds + _SETTLE
    while _moves(replay.board, start + replay.seconds) and replay.seconds < end:
        await _until(replay, tell, start, replay.seconds + _EVERY * replay.speed)


async def _until(replay: Replay, tell: Callable[[Asked | None], None], start: float, seconds: float) -> None:
    """Move on to a second of the recording, with a picture now and then."""
    loop = asyncio.get_running_loop()
    while replay.seconds < seconds:
        replay.seconds = min(seconds, replay.seconds + _EVERY * replay.speed)
        await asyncio.sleep(start + replay.seconds / replay.speed - loop.time())
        replay.board.advance(start + replay.seconds)
        tell(None)


def _moves(board: VirtualBoard, now: float) -> bool:
    return board.next_due(now) is not None or any(servo.moving for servo in board.servos.values())


@contextmanager
def _shown(replay: Replay) -> Iterator[Callable[[Asked | None], None]]:
    """Yield a function to call with each command and with None now and then: it draws, or prints the commands."""
    if can_draw():
        with pictures(lambda width, height, blocks: _picture(replay, (width, height), blocks=blocks)) as draw:

            def drawn(each: Asked | None) -> None:
                if each is None:
                    draw()
                else:
                    replay.latest = _words(each)

            yield drawn
    else:

        def printed(each: Asked | None) -> None:
            if each is not None:
                print_for_people(f"{each.seconds:10.3f}  {_words(each)}")

        yield printed


def _picture(replay: Replay, size: tuple[int, int], *, blocks: bool) -> list[Line]:
    head = [
        (f"replay {escape(replay.path)} on a virtual board", ""),
        (f"{replay.seconds:.1f} s of {replay.length:.1f} s, at {replay.speed:g} times the speed", "bold green"),
        (f"{counted(replay.done, 'command')} of {len(replay.commands)}  {escape(replay.latest)}", ""),
    ]
    return picture_of_servos(servos_of(replay.board), head, [*wrapped(LEGEND, size[0], "dim")], size, blocks=blocks)


def _words(each: Asked) -> str:
    assert each.packet is not None  # noqa: S101 - others are left out
    described = packet_to_json(each.packet)
    return in_words(described["packet"], described["fields"])


def _angles(board: VirtualBoard) -> dict[int, float]:
    return {servo.servo_id: round(servo.angle, 1) for servo in board.servos.values()}


def _text(replay: Replay) -> Iterator[Part]:
    """Yield where the servos are, and what the virtual board could not know."""
    yield Table(("servo", "angle"), list(_angles(replay.board).items()))
    yield f"played {counted(replay.done, 'command')} of {duration(replay.seconds)}"
    stored = sum(isinstance(each.packet, _STORED) for each in replay.commands)
    if stored and not any(replay.board.storage.contents.records.values()):
        yield Remark(
            f"{counted(stored, 'command')} ran what was stored on the recorded board and is not on this "
            "one; --state FILE loads it"
        )
