"""`servolink mcp`: a language model looks at a robot, plans, and moves it where a person allows that."""

from __future__ import annotations

import argparse
import asyncio
from contextlib import AsyncExitStack
from time import strftime

from servolink.cli.arguments import SPEED, file_path, whole_number
from servolink.cli.command import TOGETHER, Command, flag, group, option
from servolink.cli.command_session import Interruption, connection_options, interruptible
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import show_served
from servolink.cli.screen.terminal import can_ask
from servolink.cli.usage import usage_error
from servolink.hub import hub_of_board
from servolink.project import ProjectFile
from servolink.support import ExitCode

SPEED_CAP = 60.0
"""Default of `--speed-cap`, in degrees per second."""

MOTIONS = group(
    "motions",
    flag("--allow-motion", "offer motions; each waits for the yes of a person"),
    flag("--no-ask", "with --allow-motion: move without asking"),
    option("--speed-cap", "DEGREES", f"highest speed, degrees per second ({SPEED_CAP:g})", SPEED, default=SPEED_CAP),
)
"""Options of commands that move the robot for other programs."""


def refuse_no_ask(args: argparse.Namespace) -> None:
    """End as wrong usage with `--no-ask` and without `--allow-motion`."""
    if args.no_ask and not args.allow_motion:
        usage_error(args, "--no-ask needs --allow-motion: without it nothing moves, and nobody is asked")


def log_line(text: str) -> None:
    """Print a line of the log, with the time, on standard error."""
    print_error(f"{strftime('%H:%M:%S')} {text}")


@Command(
    "mcp",
    TOGETHER,
    help="let a language model see the robot, plan, ask, and move",
    details="A server of the Model Context Protocol. Without --http it speaks on standard input and output, and is "
    "started by the client. It can always stop the robot, and never writes to the board.",
    examples=("mcp", "mcp --project robot.servolink.json --allow-motion", "mcp --http 0"),
    options=(
        option("--project", "FILE", "a project file: its figure is drawn, and its content planned", file_path),
        option("--http", "PORT", "serve HTTP on this machine, with a token; 0: a free port", whole_number(0, 65535)),
        MOTIONS,
    ),
)
@interruptible("nothing was sent to the board", in_usage=True)
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until the client ends the connection, or until Ctrl-C or SIGTERM."""
    refuse_no_ask(args)
    from servolink.gateways import supervised
    from servolink.gateways.models import ModelTools, serve_on_http, serve_on_stdio

    project = None if args.project is None else await asyncio.to_thread(ProjectFile.read, args.project)
    async with AsyncExitStack() as stack:
        hub = await stack.enter_async_context(hub_of_board(args.url, **connection_options(args)))
        supervisor = await stack.enter_async_context(
            supervised(hub, may_move=args.allow_motion, speed_cap=args.speed_cap, log=log_line)
        )
        interruption.state, interruption.code = "the content of the board was left unchanged", ExitCode.OK
        server = ModelTools(supervisor, project, asks=not args.no_ask).server()
        if args.http is None:
            if can_ask():
                print_error("servolink: a client speaks here on standard input; Ctrl-C ends it")
            await serve_on_stdio(server)
        else:
            await serve_on_http(server, args.http, lambda url, token: show_served(mcp=url, token=token))
    return ExitCode.OK
