"""`servolink share --status`, `--take` and `--give`: a question to a hub that runs, over its control interface."""

from __future__ import annotations

import argparse
import asyncio
from typing import Any

import msgspec
from msgspec import Raw, Struct

from servolink.cli.main import OK, usage_error
from servolink.cli.output import print_json, print_table, print_text
from servolink.cli.session import Interruption, run_interruptible
from servolink.cli.share_view import facts, programs
from servolink.discovery.hubs import candidates
from servolink.discovery.names import resolve_url
from servolink.errors import OpenError, ServolinkError
from servolink.escaping import escape
from servolink.hub.control.messages import LeaseNow
from servolink.hub.notices import HubStatus
from servolink.transports.share import Greeting, greet, this_program

_MOST_SECONDS = 5.0
_SCHEME = "share://"


class _Error(Struct):
    message: str


class _Response(Struct):
    id: int | None = None
    """None in notifications."""
    result: Raw = Raw(b"null")
    error: _Error | None = None


class _Control(asyncio.Protocol):
    """A conversation with the control interface of a hub: one request after the other."""

    def __init__(self) -> None:
        self.session = ""
        self._pipe: asyncio.Transport | None = None
        self._heard = bytearray()
        self._number = 0
        self._waiting: asyncio.Future[_Response] | None = None

    async def open(self, name: str, role: Any) -> None:
        """Connect to the hub `name`. Raise OpenError if it does not run."""
        self._pipe, welcome = await greet(name, Greeting(wants="rpc", who=this_program(), role=role), self)
        self.session = welcome.session
        self._pipe.resume_reading()

    def close(self) -> None:
        if self._pipe is not None:
            self._pipe.close()

    async def ask(self, method: str, params: dict[str, Any] | None = None) -> Raw:
        """Call a method and return its result. Raise ServolinkError with the text of an error."""
        assert self._pipe is not None  # noqa: S101 - it is open
        self._number += 1
        request = {"jsonrpc": "2.0", "id": self._number, "method": method, "params": params or {}}
        self._waiting = asyncio.get_running_loop().create_future()
        self._pipe.write(msgspec.json.encode(request) + b"\n")
        async with asyncio.timeout(_MOST_SECONDS):
            response = await self._waiting
        if response.error is not None:
            raise ServolinkError(response.error.message)
        return response.result

    def data_received(self, data: bytes) -> None:
        """Take responses; notifications are ignored."""
        self._heard += data
        *lines, self._heard = self._heard.split(b"\n")
        for line in lines:
            response = msgspec.json.decode(line, type=_Response)
            if response.id == self._number and self._waiting is not None and not self._waiting.done():
                self._waiting.set_result(response)

    def connection_lost(self, exc: Exception | None) -> None:
        """Fail whoever waits."""
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_exception(ServolinkError("the hub has ended"))


def talk_to_hub(args: argparse.Namespace) -> int:
    """Do what the options say with a hub that runs."""

    async def main(interruption: Interruption) -> int:
        control = _Control()
        try:
            if args.take or args.give:
                name = args.take or args.give
                await control.open(name, "run" if args.take else "watch")
                await (_take if args.take else _give)(control, name, as_json=args.json)
            else:
                await control.open(await _chosen(args), "watch")
                await _show(control, as_json=args.json)
        except TimeoutError:
            raise OpenError(f"the hub has not answered within {_MOST_SECONDS:g} s; end it and start it again") from None
        finally:
            control.close()
        return OK

    return run_interruptible(main, "nothing was changed")


async def _chosen(args: argparse.Namespace) -> str:
    """Return the name of the hub of the board that was named, or of the only one that runs."""
    if args.url is not None or args.name is not None:
        url = args.url if args.url is not None else f"{_SCHEME}{args.name}"
        url = url if url.startswith(_SCHEME) else await resolve_url(url)
        if not url.startswith(_SCHEME):
            raise OpenError(f"{url} is not shared; `servolink share --board {escape(args.url)}` shares it")
        return url.removeprefix(_SCHEME).partition("?")[0]
    names = [hub.url.removeprefix(_SCHEME) for hub in await asyncio.to_thread(candidates)]
    if not names:
        raise OpenError("no board is shared here; `servolink share` shares one")
    if len(names) > 1:
        usage_error(args, f"{len(names)} boards are shared; choose one with --name: {', '.join(names)}")
    return names[0]


async def _show(control: _Control, *, as_json: bool) -> None:
    result = await control.ask("status")
    status = msgspec.json.decode(result, type=HubStatus)
    others = tuple(program for program in status.programs if program.session != control.session)
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


async def _take(control: _Control, name: str, *, as_json: bool) -> None:
    """Take the lease over and give it up at once, so that the next command has it and the former holder has not."""
    before = msgspec.json.decode(await control.ask("status"), type=HubStatus).lease
    if before is not None:
        await control.ask("lease.take", {"force": True})
    if as_json:
        print_json({"taken_from": before and before.who})
    elif before is None:
        print_text("nobody has the lease: any program may move the servos")
    else:
        print_text(
            f"{before.who} may not move the servos any more; what moves now moves on. "
            f"To let it move again: servolink share --give {name}"
        )


async def _give(control: _Control, name: str, *, as_json: bool) -> None:
    """Let programs move again from which the lease was taken."""
    lease = msgspec.json.decode(await control.ask("lease.give"), type=LeaseNow).lease
    if as_json:
        print_json({"moved_by": lease and lease.who})
    elif lease is None:
        print_text(f"any program may move the servos of {name}")
    else:
        print_text(f"{lease.who} moves the servos of {name}; the others may when it is done")
