"""`servolink share --status`, `--take` and `--give`: a question to a hub that runs, over its control interface."""

from __future__ import annotations

import argparse
import asyncio
from typing import Any

import msgspec

from servolink.cli.screen.output import print_json, print_table, print_text
from servolink.cli.session import Interruption, run_interruptible
from servolink.cli.together.share_view import facts, programs
from servolink.cli.usage import usage_error
from servolink.control.channel import RpcChannel, open_channel
from servolink.control.greeting import Greeting
from servolink.control.messages import LeaseNow
from servolink.control.roles import RoleName
from servolink.control.share import this_program
from servolink.control.status import HubStatus
from servolink.discovery.hubs import candidates, hub_of
from servolink.discovery.names import resolve_url
from servolink.errors import OpenError
from servolink.script import OK

_LIMIT = 5.0  # seconds for the hub to answer
_SCHEME = "share://"


def talk_to_hub(args: argparse.Namespace) -> int:
    """Do what the options say with a hub that runs."""

    async def main(interruption: Interruption) -> int:
        name = args.take or args.give or await _chosen(args)
        role: RoleName = "run" if args.take else "watch"
        channel, welcome = await open_channel(name, Greeting(wants="rpc", who=this_program(), role=role))
        try:
            if args.take:
                await _take(channel, name, as_json=args.json)
            elif args.give:
                await _give(channel, name, as_json=args.json)
            else:
                await _show(channel, welcome.session, as_json=args.json)
        finally:
            await channel.close()
        return OK

    return run_interruptible(main, "nothing was changed")


async def _chosen(args: argparse.Namespace) -> str:
    """Return the name of the hub that was named, of the hub of the board, or of the only one that runs."""
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
    names = [hub.url.removeprefix(_SCHEME) for hub in await asyncio.to_thread(candidates)]
    if not names:
        raise OpenError("no board is shared here; `servolink share` shares one")
    if len(names) > 1:
        usage_error(args, f"{len(names)} boards are shared; choose one with --name: {', '.join(names)}")
    return names[0]


async def _call(channel: RpcChannel, method: str, kind: type[Any], **params: Any) -> Any:
    return msgspec.json.decode(await channel.call(method, timeout=_LIMIT, **params), type=kind)


async def _show(channel: RpcChannel, session: str, *, as_json: bool) -> None:
    status: HubStatus = await _call(channel, "status", HubStatus)
    others = tuple(program for program in status.programs if program.session != session)
    status = msgspec.structs.replace(status, programs=others)
    if as_json:
        print_json(msgspec.to_builtins(status))
        return
    print_table(facts(status))
    if others:
        print_text("")
        print_table(programs(status))
    else:
        print_text("no program is connected")


async def _take(channel: RpcChannel, name: str, *, as_json: bool) -> None:
    """Take the lease over and give it up at once, so that the next command has it and the former holder has not."""
    before = (await _call(channel, "status", HubStatus)).lease
    if before is not None:
        await _call(channel, "lease.take", LeaseNow, force=True)
    if as_json:
        print_json({"taken_from": before and before.who})
    elif before is None:
        print_text("nobody has the lease: any program may move the servos")
    else:
        print_text(
            f"{before.who} may not move the servos any more; what moves now moves on. "
            f"To let it move again: servolink share --give {name}"
        )


async def _give(channel: RpcChannel, name: str, *, as_json: bool) -> None:
    """Allow programs whose lease was taken to move the servos again."""
    lease = (await _call(channel, "lease.give", LeaseNow)).lease
    if as_json:
        print_json({"moved_by": lease and lease.who})
    elif lease is None:
        print_text(f"any program may move the servos of {name}")
    else:
        print_text(f"{lease.who} moves the servos of {name}; the others may when it is done")
