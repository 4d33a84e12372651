"""`servolink replay`: the board of a recording for other programs, or its commands on a virtual robot."""

from __future__ import annotations

import argparse
import asyncio
import json
from contextlib import AsyncExitStack
from pathlib import Path

from servolink.cli.arguments import listening, not_empty, number
from servolink.cli.main import OK, usage_error
from servolink.cli.session import Interruption, run_interruptible
from servolink.listeners import host_and_port, serve_network, serve_terminal
from servolink.platforms.pseudo_terminals import AVAILABLE
from servolink.protocol.frame import MAGIC
from servolink.recorder.conversation import read_conversation
from servolink.recorder.reading import Recording
from servolink.recorder.replaying import RecordedBoardTransport
from servolink.transports.base import Transport

_VIRTUAL = "virtual"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink replay`."""
    parser.set_defaults(run=run)
    parser.description = (
        f"{parser.description}\n\nWithout --to, programs connect to the recorded board, until Ctrl-C, its normal end.\n"
        "It answers as it did, as long as a program sends the same commands."
    )
    parser.add_argument("file", type=not_empty, metavar="FILE", help="a recording")
    parser.add_argument("--to", type=not_empty, metavar=_VIRTUAL, help="play the commands on a virtual board")
    parser.add_argument(
        "--speed", type=number(0.01, 1000, "times"), default=1.0, metavar="N", help="play N times as fast (1)"
    )
    parser.add_argument(
        "--state",
        type=not_empty,
        metavar="FILE",
        help="with --to: what the virtual board stores (see `virtual --state`)",
    )
    parser.add_argument("--pty", action="store_true", help="serve a pseudo-terminal (the default without --tcp)")
    parser.add_argument("--tcp", metavar="HOST:PORT", type=listening, help="serve TCP; port 0 takes a free one")


def run(args: argparse.Namespace) -> int:
    """Play the commands on a virtual board, or serve the recorded board until Ctrl-C."""
    if args.to is None:
        if args.state:
            usage_error(args, "--state needs --to virtual")
        return _serve(args)
    if args.to.partition(":")[0] != _VIRTUAL:
        usage_error(
            args,
            f"--to must be virtual, not {args.to!r}: nobody knows what stands around a real robot now, so a recording "
            "is never played on one",
        )
    if args.to not in (_VIRTUAL, f"{_VIRTUAL}://") or args.pty or args.tcp:
        usage_error(
            args, "--to virtual plays on a board of its own, which nobody can connect to and which has no options"
        )
    from servolink.cli.replay_robot import play

    return play(args)


def _serve(args: argparse.Namespace) -> int:
    with Recording(Path(args.file)) as recording:  # now, so that errors come before anybody connects
        read_conversation(recording)

    def connect() -> Transport:
        return RecordedBoardTransport(args.file, speed=args.speed)

    async def main(interruption: Interruption) -> int:
        interruption.code = OK
        pty = args.pty or (AVAILABLE and not args.tcp)
        tcp = args.tcp or (None if pty else "127.0.0.1:0")
        async with AsyncExitStack() as stack:
            urls = [await stack.enter_async_context(serve_terminal(connect))] if pty else []
            if tcp:
                served = serve_network(connect, *host_and_port(tcp), begins_with=MAGIC)
                urls.append(await stack.enter_async_context(served))
            for url in urls:
                print(json.dumps({"listening": url}) if args.json else f"listening {url}", flush=True)
            await asyncio.Event().wait()
        return OK

    return run_interruptible(main, "the recorded board is gone")
