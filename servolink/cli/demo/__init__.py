"""`servolink demo`: all of it in about ten seconds, on a virtual board behind a real serial line."""

from __future__ import annotations

import argparse
import asyncio
import shlex
import shutil
import socket
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from servolink.cli.demo.line import FaultyLine
from servolink.cli.demo.scene import Scene
from servolink.cli.demo.stage import JsonStage, Outcome, Stage, TextStage
from servolink.cli.demo.steps import STEPS
from servolink.cli.main import FAILED, OK
from servolink.cli.session import Interruption, run_interruptible
from servolink.cli.signals import ENDING, handled
from servolink.client.connect import connect
from servolink.errors import ServolinkError
from servolink.transports.registry import create
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serving import serve
from servolink.virtual.terminal import AVAILABLE

_SERVOS = 16
_FAST = 0.05


def configure(command: str, parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink demo`."""
    parser.add_argument("--fast", action="store_true", help="do the same with quick movements and no time to read")


def run(args: argparse.Namespace) -> int:
    """Play all steps: 0, or 1 if a check failed."""
    stage: Stage = JsonStage() if args.json else TextStage(fast=args.fast)

    async def main(interruption: Interruption) -> int:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - narrows the type: this runs in one
        with handled(task.cancel, ENDING[1:]):  # or its folder would be left; Ctrl-C does the same
            return await _play(stage, _FAST if args.fast else 1.0)

    return run_interruptible(main, "only the demo's own virtual board was moved")


async def _play(stage: Stage, pace: float) -> int:
    start = asyncio.get_running_loop().time()
    virtual, second = VirtualBoard(_SERVOS, seed=1), VirtualBoard(_SERVOS, seed=2)
    with tempfile.TemporaryDirectory(prefix="servolink-demo-") as folder:
        async with _served(virtual) as url, _served(second) as second_url:
            line = FaultyLine(create(url))
            async with connect(line) as board:
                scene = Scene(board, virtual, line, second, second_url, stage, Path(folder), pace)
                failed = await _steps(scene)
                stats = board.stats.as_dict()
    seconds = round(asyncio.get_running_loop().time() - start, 3)
    stage.end({"ok": not failed, "failed": failed, "seconds": seconds, "next": _next_commands(), "stats": stats})
    return FAILED if failed else OK


@asynccontextmanager
async def _served(board: VirtualBoard) -> AsyncIterator[str]:
    """Serve `board` over what a board is usually connected by; yield its address."""
    async with serve(board, pty=AVAILABLE, tcp=None if AVAILABLE else "127.0.0.1:0") as (url,):
        yield url


async def _steps(scene: Scene) -> list[str]:
    """Play the steps and return those that failed; an error ends the play."""
    failed: list[str] = []
    for name, title, play in STEPS:
        scene.stage.begin(title)
        try:
            outcome = await play(scene)
        except (ServolinkError, TimeoutError) as error:
            reason = str(error) or "nothing came in time"
            await scene.stage.finish(name, Outcome({"error": reason}, {reason: False}))
            return [*failed, name]
        await scene.stage.finish(name, outcome)
        if not outcome.ok:
            failed.append(name)
    return failed


def _next_commands() -> list[str]:
    """Return commands that work when they are pasted, wherever this one was started from."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    servolink = own_name()
    return [
        f"{servolink} virtual --tcp {place}",
        f"{servolink} --url tcp://{place} servos",
        f"{servolink} --url tcp://{place} move 1=60 2=-30 --speed 45",
    ]


def own_name() -> str:
    """Return how this program was called."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m servolink"
    found = shutil.which("servolink")
    return "servolink" if found and Path(found).resolve() == called.resolve() else shlex.quote(str(called))
