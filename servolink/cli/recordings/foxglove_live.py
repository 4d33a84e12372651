"""`servolink foxglove`: the robot live in Foxglove, or a recording of it."""

from __future__ import annotations

import argparse
import asyncio
from contextlib import AsyncExitStack

from servolink.cli.arguments import SPEED, file_path, listening, new_file, number
from servolink.cli.command import RECORDINGS, Command, flag, option
from servolink.cli.command_session import ENDLESS, Interruption, connection_options, interruptible
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import show_served
from servolink.cli.screen.terminal import can_ask, confirm_motion
from servolink.cli.together.language_models import SPEED_CAP, log_line
from servolink.cli.usage import usage_error
from servolink.gateways import supervised
from servolink.hub import hub_of_board
from servolink.project import ProjectFile
from servolink.recorder import Recording
from servolink.support import ExitCode
from servolink.transports import NetworkPlace


@Command(
    "foxglove",
    RECORDINGS,
    help="show the robot live in Foxglove, or a recording",
    details=f"Foxglove opens the address as a WebSocket connection. {ENDLESS}",
    examples=("foxglove", "foxglove --project robot.servolink.json", "foxglove --recording out.mcap --speed 2"),
    options=(
        option("--recording", "FILE", "show a recording, once, in place of a board", file_path),
        option("--speed", "N", "with --recording: N times as fast (1)", number(0.01, 1000, "times"), default=1.0),
        option("--project", "FILE", "a project file with a figure: adds transforms and the scene", file_path),
        option("--mcap", "OUT", "also write these channels to a new file", new_file),
        option(
            "--listen",
            "HOST:PORT",
            "where to serve; port 0 takes a free one (127.0.0.1:8765)",
            listening,
            default="127.0.0.1:8765",
        ),
        flag("--allow-motion", "move to published targets; each is asked at this terminal"),
        option(
            "--speed-cap", "DEGREES", f"highest speed, degrees per second ({SPEED_CAP:g})", SPEED, default=SPEED_CAP
        ),
    ),
)
@interruptible("nothing was sent to the board", in_usage=True)
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until Ctrl-C or SIGTERM, or until the hub has ended."""
    if args.allow_motion and args.recording is not None:
        usage_error(args, "--allow-motion moves a board, and --recording has none; leave out one of them")
    if args.allow_motion and not can_ask():
        usage_error(args, "--allow-motion asks before each motion, and needs a terminal for the question")
    from servolink.gateways.foxglove import LiveChannels, PublishedTargets, serving, written_to

    import foxglove  # isort: skip # pyright: ignore[reportMissingImports] # after the door, which says what to install

    figure = None if args.project is None else (await asyncio.to_thread(ProjectFile.read, args.project)).figure
    context = foxglove.Context()
    channels = LiveChannels(context, figure)
    async with AsyncExitStack() as stack:
        recording = None if args.recording is None else await asyncio.to_thread(Recording, args.recording)
        hub = ""
        if recording is None:
            hub = await stack.enter_async_context(hub_of_board(args.url, **connection_options(args)))
        supervisor = None
        if args.allow_motion:
            watched = supervised(hub, may_move=True, speed_cap=args.speed_cap, log=log_line)
            supervisor = await stack.enter_async_context(watched)
        if args.mcap is not None:
            stack.enter_context(written_to(args.mcap, context))
            channels.draw_scene(recording.started if recording is not None else 0)
        listener = PublishedTargets(channels, supervisor, args.speed_cap, confirm_motion)
        host, port = NetworkPlace.parse(args.listen)
        served = serving(listener, context, host, port, may_move=args.allow_motion)
        found = await stack.enter_async_context(served)
        interruption.state, interruption.code = "the content of the board was left unchanged", ExitCode.OK
        place = NetworkPlace(host, found)
        url = f"ws://{place}"
        show_served(foxglove=url)
        print_error(f"servolink: {url} is open to {place.reached_by}, and to pages in a browser")
        if recording is not None:
            await channels.follow_recording(recording, args.speed)
            await asyncio.Event().wait()
        await channels.follow_hub(hub)
        print_error(f"servolink: the hub {hub} has ended")
    return ExitCode.OK
