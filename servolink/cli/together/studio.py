"""`servolink studio`: the page on this machine."""

from __future__ import annotations

import argparse
import asyncio
import re
from contextlib import AsyncExitStack
from ipaddress import ip_address

from servolink.cli.arguments import not_empty
from servolink.cli.command import FIRST_STEPS, Command, flag, group, option
from servolink.cli.command_session import Interruption, connection_options, interruptible
from servolink.cli.fleet.broker_options import ACCESS, BROKER_VARIABLE, GROUPS_FILE, fleet_of
from servolink.cli.screen.output import print_error
from servolink.cli.screen.result import show_served
from servolink.cli.usage import refuse_board, usage_error
from servolink.errors import quote
from servolink.support import ExitCode

_MOST_PORT = 65535
_NAME = r"(?:[\w.-]+|\[[0-9A-Fa-f:.]+\])"
_HOST = re.compile(rf"{_NAME}|https://{_NAME}(:[0-9]{{1,5}})?/?", re.ASCII)
_NOT_ENCRYPTED = (
    "the studio is not encrypted: everybody in this network who reads along can do what these addresses allow; "
    "put it behind a proxy that speaks TLS"
)


def _port(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) > _MOST_PORT:
        raise argparse.ArgumentTypeError(f"must be a port from 0 to {_MOST_PORT}, not {quote(text)}")
    return int(text)


def _place(text: str) -> str:
    if text not in {"*", "localhost"}:
        try:
            ip_address(text)
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"must be an IP address of this machine, or * for all of them, not {quote(text)}"
            ) from None
    return text


def _is_local(place: str) -> bool:
    """Return whether an address is reachable only from this machine."""
    return place == "localhost" or (place != "*" and ip_address(place).is_loopback)


def _host(text: str) -> str:
    if not _HOST.fullmatch(text):
        raise argparse.ArgumentTypeError(
            "must be a name or address, as in robot.local, or https://NAME of a proxy that speaks TLS, not "
            f"{quote(text)}"
        )
    return text


@Command(
    "studio",
    FIRST_STEPS,
    help="see and move the robot in the browser",
    examples=("studio", "studio --demo", "studio --fleet mqtt://teacher.local"),
    options=(
        flag("--demo", "use a new virtual board, whatever is plugged in"),
        option("--port", "N", "port of the page; 0: as last time (0)", _port, default=0),
        flag("--no-browser", "only print the address"),
        option("--forecast", "FIGURE", "try motions on the twin of a project file first", not_empty),
        group(
            "for tablets and other machines",
            option("--host", "ADDRESS", "where to listen; *: everywhere (127.0.0.1)", _place, default="127.0.0.1"),
            option(
                "--allow-host",
                "NAME",
                "a name or address under which other machines reach this one, or https://NAME of a proxy that "
                "speaks TLS; may be repeated",
                _host,
                action="append",
                default=[],
            ),
        ),
        group(
            "a fleet",
            option(
                "--fleet",
                "URL",
                f"show the boards of this broker too, such as mqtt://teacher.local ({BROKER_VARIABLE}; mqtt://localhost)",
                dest="broker",
                nargs="?",
                const="",
            ),
            GROUPS_FILE,
        ),
        *ACCESS,
    ),
)
@interruptible("nothing was sent to the board", in_usage=True)
async def run(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve the studio until Ctrl-C or SIGTERM."""
    if args.demo:
        refuse_board(args, "--demo uses a board of its own; leave out --board")
    if not args.allow_host and not _is_local(args.host):
        usage_error(
            args,
            f"--host {args.host} opens the studio to the network: say under which names it is reached, as in "
            "--allow-host robot.local, or leave --host out",
        )
    from servolink.studio import Links, opened_in_browser, serve_studio, studio_for

    async with AsyncExitStack() as stack:
        studio = await stack.enter_async_context(
            studio_for(args.url, demo=args.demo, forecast=args.forecast, **connection_options(args))
        )
        if args.broker is not None:
            from servolink.studio import FleetView

            studio.fleet = FleetView(await stack.enter_async_context(fleet_of(args)))
        gate, port = await stack.enter_async_context(serve_studio(studio, args.host, args.port, args.allow_host))
        interruption.state, interruption.code = "the board was left unchanged", ExitCode.OK
        address = f"{gate.address}/#token={gate.new_token('edit')}"
        show_served(studio=address)
        if args.allow_host:
            if not all(host.startswith("https://") for host in args.allow_host):
                print_error(f"servolink: {_NOT_ENCRYPTED}")
            studio.links = Links(gate, port, tuple(args.allow_host))
            for link in studio.links.addresses():
                show_served(**{"drive" if link.role == "edit" else "watch": link.address})
        if not args.no_browser:
            stack.enter_context(opened_in_browser(address))
        await asyncio.Event().wait()
    return ExitCode.OK
