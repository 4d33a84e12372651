"""`servolink virtual`: a virtual board for other programs, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, AsyncExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from servolink.boards import announced
from servolink.cli.arguments import file_path, listening, whole_number
from servolink.cli.command import DEVELOPERS, Command, Option, flag, group, option
from servolink.cli.screen.live import can_draw
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import show_served
from servolink.cli.screen.terminal import single_keys
from servolink.cli.screen.virtual_view import shown
from servolink.cli.usage import usage_error
from servolink.errors import TransportUnavailable
from servolink.protocol import Codec
from servolink.support import MIB, ExitCode, PseudoTerminal, Signals, read_text, reason
from servolink.transports import DeviceInfo, Faults
from servolink.twin import read_board
from servolink.virtual import (
    BoardKind,
    Event,
    Keys,
    KindOption,
    Push,
    StateFile,
    StateSaver,
    VirtualBoard,
    parse_script,
    serve,
)


def _kind(kind: KindOption) -> Option:
    """Return the option of a property of boards."""

    def read(text: str) -> Any:
        try:
            return kind.read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    name = "--" + kind.name.replace("_", "-")
    if kind.is_flag:
        return flag(name, kind.meaning)
    help_text = f"{kind.meaning} ({kind.default_text})"
    return option(name, kind.unit, help_text, read, default=kind.default)


def _faults(text: str) -> Faults:
    try:
        return Faults.parse(text)
    except TransportUnavailable as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _state(text: str) -> Path:
    """Return the path. Check now that saving will be possible, as nothing is lost yet."""
    path = Path(text)
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise argparse.ArgumentTypeError(f"{text}: the folder {folder} does not exist; create it, or take another name")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise argparse.ArgumentTypeError(f"{text}: the folder {folder} cannot be written; take another one")
    return path


def _script(text: str) -> list[Event]:
    try:
        return parse_script(read_text(Path(text), MIB))
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{text}: {reason(error)}") from None


@Command(
    "virtual",
    DEVELOPERS,
    help="serve a virtual board over a pseudo-terminal or TCP",
    details="Ctrl-C is its normal end, with exit code 0.",
    examples=("virtual", "virtual --tcp 127.0.0.1:7878 --servos 4", "virtual --state arm.state --faults drop=0.01"),
    options=(
        flag("--pty", "serve a pseudo-terminal (the default without --tcp)"),
        option("--tcp", "HOST:PORT", "serve TCP; port 0 takes a free one", listening),
        option(
            "--servos", "N", "number of servos (16, or those of the body)", whole_number(0, VirtualBoard.MAX_SERVOS)
        ),
        option(
            "--seed",
            "N",
            "boards with the same number differ in nothing (0)",
            whole_number(-(2**63), 2**63 - 1),
            default=0,
        ),
        option("--faults", "NAME=VALUE,...", "a bad line: drop=0.01,delay=0.1 and more", _faults),
        option("--state", "FILE", "load what is stored from it, and save every change to it", _state),
        option("--twin", "FILE", "give the board the body of a project: servos sag, lag, stall and fall", file_path),
        option("--script", "FILE", "what people do to the board, such as: 1.5 press 3", _script, default=[]),
        group("kind of board", *map(_kind, BoardKind.options())),
    ),
    takes_board=False,
)
def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    board = _board(args)
    pushed = {event.servo_id for event in args.script if isinstance(event, Push)}
    if unknown := sorted(pushed - board.servos.keys()):
        usage_error(args, f"--script pushes servo {unknown[0]}, and the board has {len(board.servos)} servos")
    with StateFile(board, args.state) if args.state else nullcontext() as file:
        try:
            asyncio.run(_serve(board, args, file))
        finally:
            if file is not None:
                file.save()
    print_error(f"ended: what the board stores is {f'kept in {args.state}' if args.state else 'gone'}")
    return ExitCode.OK


def _board(args: argparse.Namespace) -> VirtualBoard:
    """Return the board. Raise ProjectError or TwinError for a body that is impossible here."""
    codec = Codec(args.byte_order or "little", args.caption_encoding or "utf-8")
    kind = BoardKind(**{kind.name: getattr(args, kind.name) for kind in BoardKind.options()})
    if args.twin is None:
        return VirtualBoard(16 if args.servos is None else args.servos, args.seed, codec, kind)

    return read_board(args.twin, servos=args.servos, seed=args.seed, codec=codec, kind=kind)


async def _serve(board: VirtualBoard, args: argparse.Namespace, file: StateFile | None) -> None:
    stop = _stop_on_signals()
    pty = args.pty or (PseudoTerminal.AVAILABLE and not args.tcp)
    tcp = args.tcp or (None if pty else "127.0.0.1:0")
    serving = serve(board, pty=pty, tcp=tcp, faults=args.faults, seed=args.seed)
    async with serving as urls, AsyncExitStack() as stack:
        stack.enter_context(_announced(urls, board))
        if file is not None:
            StateSaver(board, file)  # until the loop ends
        stack.enter_context(_playing(board, args.script))
        stack.enter_context(_keyboard(board))
        for url in urls:
            show_served(listening=url)
        if can_draw():
            await stack.enter_async_context(shown(board, urls))
        await stop.wait()


def _announced(urls: list[str], board: VirtualBoard) -> AbstractContextManager[None]:
    """Announce the board to `servolink list`: once, at the address for several hosts where available."""
    url = urls[-1] if board.codec.byte_order == "little" else f"{urls[-1]}?byte_order={board.codec.byte_order}"
    return announced(DeviceInfo(url, f"virtual board with {len(board.servos)} servos"))


def _stop_on_signals() -> asyncio.Event:
    """Return the event set by Ctrl-C, SIGTERM and a closed terminal, unless the signals are ignored.

    The handlers stay until the program ends, so that a second signal does not keep the board from being saved.
    """
    loop, stop = asyncio.get_running_loop(), asyncio.Event()

    def end(*_: object) -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(stop.set)

    for number in Signals.ENDING.not_ignored():
        signal.signal(number, end)
    return stop


@contextmanager
def _playing(board: VirtualBoard, events: Iterable[Event]) -> Iterator[None]:
    """Play the events of a script, with times from now on."""
    loop = asyncio.get_running_loop()
    timers = [loop.call_later(event.at, _apply, board, event) for event in events]
    try:
        yield
    finally:
        for timer in timers:
            timer.cancel()


def _apply(board: VirtualBoard, event: Event) -> None:
    """Apply a scripted event to the board, and print a push without effect."""
    if isinstance(event, Push) and board.servos[event.servo_id].is_hold:
        print(f"servolink: servo {event.servo_id} is held and is not pushed at {event.at:g} s", file=sys.stderr)
    event.apply(board, asyncio.get_running_loop().time())


@contextmanager
def _keyboard(board: VirtualBoard) -> Iterator[None]:
    """Press buttons and the power switch with keys, if standard input is a terminal."""
    keys = Keys()

    def typed(text: str) -> None:
        for event in keys.typed(text):
            asyncio.get_running_loop().call_later(event.at, _apply, board, event)

    with single_keys(typed) as there:
        if there:
            print(Keys.HELP, file=sys.stderr, flush=True)
        yield
