"""`servolink fleet join`: the boards of this machine take part in a fleet, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import gc
import os
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING

from servolink.cli.arguments import board_name, file_path, not_empty, number, timeout
from servolink.cli.command import Command, flag, group, option
from servolink.cli.command_session import ENDLESS, Interruption, connection_options, interruptible
from servolink.cli.fleet.broker_options import ACCESS, BROKER_VARIABLE, access_of
from servolink.cli.screen.live import can_draw, staying_line
from servolink.cli.screen.output import counted, cut, print_error
from servolink.cli.screen.result import CommandResult, show
from servolink.cli.usage import named_board, usage_error
from servolink.errors import escape
from servolink.support import ExitCode, Tasks

if TYPE_CHECKING:
    from servolink.fleet import LocalBoard, LocalFleet

_MOST_HZ = 100.0


@Command(
    "fleet join",
    help="let the boards of this machine take part in a fleet",
    details=ENDLESS,
    examples=("fleet join mqtt://teacher.local", "fleet join mqtt://teacher.local virtual:// --name rex"),
    options=(
        option(
            "broker",
            "URL",
            f"such as mqtt://teacher.local or mqtts://USER@HOST:8883 ({BROKER_VARIABLE})",
            not_empty,
            nargs="?",
        ),
        option("boards", "BOARD", "names or addresses (all connected boards)", not_empty, nargs="*"),
        option("--name", "NAME", "what the fleet calls the board (the name of its hub)", board_name),
        option("--policy", "FILE", "what may be done from afar (fleet.toml in the user's config folder)", file_path),
        option(
            "--hz",
            "N",
            "how often the servos are sent; 0 for never (10)",
            number(0.0, _MOST_HZ, "times a second"),
            default=10.0,
        ),
        group(
            "Home Assistant",
            flag("--home-assistant", "have Home Assistant find the boards"),
            flag("--numbers", "let it set the angle of each servo, too"),
            option("--discovery-prefix", "TEXT", "where it looks for devices (homeassistant)", not_empty),
        ),
        *ACCESS,
        timeout("how long to wait for each response of a board, 3 unless given"),
    ),
    takes_board=False,
)
@interruptible("nothing was sent to the boards", in_usage=True)
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Join until Ctrl-C or SIGTERM."""
    broker = args.broker or os.environ.get(BROKER_VARIABLE)
    if not broker:
        usage_error(args, f"which broker? Name one, as in mqtt://teacher.local, or set {BROKER_VARIABLE}")
    if (args.numbers or args.discovery_prefix) and not args.home_assistant:
        usage_error(args, "--numbers and --discovery-prefix belong to --home-assistant")
    from servolink.fleet import PREFIX, HomeAssistant, LocalFleet, PolicyFile, Topics, local_boards

    names = [*args.boards, *filter(None, [named_board(args)])]
    topics, policy_file = Topics(args.prefix or PREFIX), PolicyFile(args.policy)
    where = Topics(args.discovery_prefix or HomeAssistant().prefix).prefix
    found_by = HomeAssistant(where, args.numbers) if args.home_assistant else None
    access = await asyncio.to_thread(access_of, args, broker)
    async with AsyncExitStack() as stack:
        members = await stack.enter_async_context(local_boards(names, args.name, **connection_options(args)))
        interruption.state, interruption.code = "the boards were left unchanged", ExitCode.OK
        fleet = LocalFleet(access, topics, policy_file.policies, hz=args.hz, home_assistant=found_by)
        if can_draw():
            address = str(access.address)
            show = await stack.enter_async_context(staying_line(lambda width: _status_line(fleet, address, width)))
            fleet.on_line = lambda level, text: show(text, "" if level == "info" else "yellow")
        else:
            fleet.on_line = lambda level, text: None if level == "info" else print_error(f"servolink: {text}")

        def joined() -> None:
            _show_joined(fleet, members, str(access.address), topics.prefix)
            if not names:
                fleet.on_line("warning", "boards that are connected later do not join before a new `fleet join`")
            gc.freeze()  # examining earlier objects takes longer than starting the boards

        following = Tasks()
        following.begin(fleet.follow(policy_file))
        stack.push_async_callback(following.close)
        await fleet.join(members, joined)
    return ExitCode.OK


class BoardJoined(CommandResult, frozen=True):
    """JSON of each board of `fleet join`; `allow` is the right of other people."""

    joined: str
    hub: str
    broker: str
    topic: str
    allow: str


def _show_joined(fleet: LocalFleet, members: list[LocalBoard], broker: str, prefix: str) -> None:
    for (hub, name), bridge in zip(members, fleet.bridges, strict=True):
        allow = bridge.telemetry.now.allow
        show(
            BoardJoined(name, f"share://{hub}", broker, f"{prefix}/{name}", allow),
            f"joined {name} (share://{hub}) at {broker} as {prefix}/{name}: {_ALLOWED[allow]}",
        )


_ALLOWED = {
    "watch": "other people may watch and stop the board",
    "run": "other people may watch and stop the board, and run stored actions and macros",
    "move": "other people may watch, stop and move the board",
    "edit": "other people may watch, stop and move the board, and change stored content",
}


def _status_line(fleet: LocalFleet, broker: str, width: int) -> tuple[bool, str]:
    """Return whether all is fine, and the line that stays, cut to `width` columns."""
    nows = [bridge.telemetry.now for bridge in fleet.bridges]
    away = [now.board for now in nows if now.connection != "connected"]
    is_joined = bool(nows) and all(bridge.broker.is_connected for bridge in fleet.bridges)
    moved = [f"{now.board} is moved by {now.lease}" for now in nows if now.lease]
    parts = [broker if is_joined else f"{broker} (not connected)", counted(len(nows), "board")]
    if is_joined and away:
        parts.append(f"not connected: {', '.join(away)}")
    return is_joined and not away, cut(escape("  ".join(parts + moved)), width)
