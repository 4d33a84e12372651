"""`servolink share`: one board for many programs, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
import gc
from contextlib import AsyncExitStack
from functools import partial
from typing import Any

import msgspec

from servolink.boards import hub_of, resolve_url, running_hubs
from servolink.cli.arguments import board_name, listening, not_empty, number
from servolink.cli.command import TOGETHER, Command, flag, group, one_of, option
from servolink.cli.command_session import (
    Interruption,
    choose_board,
    connection_options,
    interruptible,
    run_interruptible,
)
from servolink.cli.screen.live import can_draw
from servolink.cli.screen.output import counted, print_error
from servolink.cli.screen.result import CommandResult, Ending, Part, Returned, show_served
from servolink.cli.together.share_view import facts, in_the_log, on_terminal, programs
from servolink.cli.usage import usage_error
from servolink.control import Greeting, HubStatus, LeaseNow, RoleName, RpcChannel, decode, open_channel, this_program
from servolink.errors import OpenError
from servolink.hub import serve_board
from servolink.support import ExitCode
from servolink.transports import NetworkPlace
from servolink.twin import PhysicsProcess

_MOST_SECONDS = 3600.0


@Command(
    "share",
    TOGETHER,
    help="share one board among programs that use it at the same time",
    examples=("share", "share --name rex --tcp 127.0.0.1:0", "share --name rex --watch-tcp 127.0.0.1:0"),
    options=(
        option("--name", "NAME", "name in share://NAME, the address for programs (the name of the board)", board_name),
        option(
            "--tcp", "HOST:PORT", "also serve TCP, for programs in any language; port 0 takes a free one", listening
        ),
        option("--watch-tcp", "HOST:PORT", "the same for programs that may only read", listening),
        option("--pty", "LINK", "also serve a serial port, and link to it at LINK", nargs="?", const=""),
        option("--unit", "degree|adc", "angle unit of programs that set none (degree)", default="degree"),
        option("--door-byte-order", "little|big", "byte order of programs behind --tcp and --pty (that of the board)"),
        option(
            "--lease-seconds",
            "N",
            "how long after its last movement a program keeps the lease (10)",
            number(0.0, _MOST_SECONDS, "seconds"),
            default=10.0,
        ),
        option("--forecast", "FIGURE", "try motions on the twin of a project file first, and refuse falls", not_empty),
        option(
            "--uncertain",
            "refuse|ask|pass",
            "with --forecast: what happens to motions whose outcome is uncertain (ask)",
            default="ask",
            choices=("refuse", "ask", "pass"),
        ),
        flag("--guard", "stop all servos when one is stalled, unless the profile of the board says no"),
        group(
            "to a hub that runs",
            one_of(
                flag("--status", "show its programs and counters"),
                option(
                    "--take", "NAME", "end the lease of the program that moves the servos, and keep it out", board_name
                ),
                option("--give", "NAME", "let it move them again", board_name),
            ),
        ),
    ),
)
def run(args: argparse.Namespace) -> Ending:
    """Share the board until Ctrl-C or SIGTERM, or talk to a hub that runs."""
    if args.status or args.take or args.give:
        return talk_to_hub(args)

    args.url = choose_board(args)
    return run_interruptible(partial(_share, args), "nothing was sent to the board", usage=args)


async def _share(args: argparse.Namespace, interruption: Interruption) -> int:
    """Serve until the task is cancelled."""
    served = serve_board(
        args.url,
        name=args.name,
        tcp=args.tcp,
        watch_tcp=args.watch_tcp,
        pty=args.pty,
        unit=args.unit,
        door_byte_order=args.door_byte_order,
        lease_seconds=args.lease_seconds,
        guard=args.guard,
        forecast=None if args.forecast is None else PhysicsProcess.checker(args.forecast),
        uncertain=args.uncertain,
        **connection_options(args),
    )
    async with AsyncExitStack() as stack:
        hub, urls = await stack.enter_async_context(served)
        interruption.state, interruption.code = "the board was left unchanged", ExitCode.OK
        watch_url = urls[1 + (args.tcp is not None)] if args.watch_tcp is not None else ""
        _print_doors(urls, watch_url)
        if can_draw():
            show = await stack.enter_async_context(on_terminal(hub.status))
        else:
            show = stack.enter_context(in_the_log())
        stack.callback(hub.listen(lambda notice, session: show(notice, hub.name_of(session))))
        gc.freeze()  # a search for garbage among all that is loaded would hold up motions and stops for 30 ms
        try:
            await asyncio.Event().wait()
        finally:
            if there := sum(program.door != "local" for program in hub.programs.values()):
                interruption.state = f"the board was left unchanged, and {counted(there, 'program')} disconnected"
    return ExitCode.OK


def _print_doors(urls: list[str], watch_url: str) -> None:
    """Print the addresses, and the machines that can reach TCP addresses; programs at `watch_url` may only read."""
    for url in urls:
        show_served(listening=url)
    for url in urls:
        if url.startswith("tcp://"):
            place = NetworkPlace.parse(url.removeprefix("tcp://"))
            what = ", but only for reading" if url == watch_url else ""
            print_error(f"servolink: {url} is open to {place.reached_by}{what}")


# --- to a hub that runs -----------------------------------------------------------------------------------------------

_LIMIT = 5.0  # seconds for the hub to answer
_SCHEME = "share://"


@interruptible("nothing was changed")
async def talk_to_hub(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Carry out the options on a running hub."""
    name = args.take or args.give or await _chosen(args)
    role: RoleName = "run" if args.take else "watch"
    channel, welcome = await open_channel(name, Greeting(wants="rpc", who=this_program(), role=role))
    try:
        if args.take:
            return await _take(channel, name)
        if args.give:
            return await _give(channel, name)
        return await _status(channel, welcome.session)
    finally:
        await channel.close()


async def _chosen(args: argparse.Namespace) -> str:
    """Return the name of the hub given by name, of the hub of the board, or of the only running hub."""
    if args.name is not None:
        return str(args.name)
    if args.url is not None:
        url = await resolve_url(args.url)
        if not url.startswith(_SCHEME):
            hub = await asyncio.to_thread(hub_of, url)
            if hub is None:
                raise OpenError(f"{url} is not shared; `servolink share --board {args.url}` shares it")
            url = hub.url
        return url.removeprefix(_SCHEME).partition("?")[0]
    names = [hub.url.removeprefix(_SCHEME) for hub in await asyncio.to_thread(running_hubs)]
    if not names:
        raise OpenError("no board is shared here; `servolink share` shares one")
    if len(names) > 1:
        usage_error(args, f"{len(names)} boards are shared; choose one with --name: {', '.join(names)}")
    return names[0]


async def _call(channel: RpcChannel, method: str, kind: type[Any], **params: Any) -> Any:
    return decode(await channel.call(method, timeout=_LIMIT, **params), kind)


async def _status(channel: RpcChannel, session: str) -> Returned:
    status: HubStatus = await _call(channel, "status", HubStatus)
    others = tuple(program for program in status.programs if program.session != session)
    status = msgspec.structs.replace(status, programs=others)
    connected: list[Part] = ["", programs(status)] if others else ["no program is connected"]
    return Returned(msgspec.to_builtins(status), [facts(status), *connected])


class LeaseTaken(CommandResult, frozen=True):
    """JSON of `share` with --take: the program that had the lease."""

    taken_from: str | None


class LeaseGiven(CommandResult, frozen=True):
    """JSON of `share` with --give: the program that moves the servos now."""

    moved_by: str | None


async def _take(channel: RpcChannel, name: str) -> Returned:
    """Take the lease over and end the lease at once, so that the next command can have the lease."""
    before = (await _call(channel, "status", HubStatus)).lease
    if before is not None:
        await _call(channel, "lease.take", LeaseNow, force=True)
    text = "nobody has the lease: any program may move the servos"
    if before is not None:
        text = (
            f"{before.who} may not move the servos any more; what moves now moves on. "
            f"To let it move again: servolink share --give {name}"
        )
    return Returned(LeaseTaken(before and before.who), text)


async def _give(channel: RpcChannel, name: str) -> Returned:
    """Allow programs whose lease was taken to move the servos again."""
    lease = (await _call(channel, "lease.give", LeaseNow)).lease
    text = f"any program may move the servos of {name}"
    if lease is not None:
        text = f"{lease.who} moves the servos of {name}; the others may when it is done"
    return Returned(LeaseGiven(lease and lease.who), text)
