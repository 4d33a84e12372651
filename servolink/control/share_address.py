"""A board that a hub on this machine shares: `share://NAME`.

The hub listens on a local socket (`support/platforms/local_sockets.py`). A session begins with one line of JSON in
each direction, the Greeting of the program and the Welcome of the hub. After that it carries frames, or JSON-RPC.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import ClassVar, cast

import msgspec

from servolink.control.greeting import VERSION, Greeting, Refusal, Welcome
from servolink.control.rights import Role, RoleName
from servolink.errors import OpenError, escape
from servolink.support import connect_locally, is_name, reason
from servolink.transports import Address, StreamTransport

_MOST_WELCOME = 1024 * 1024
_WELCOME_LIMIT = 5.0  # seconds
_MOST_WHO = 80
_FLAGS = {"-v", "-vv", "--verbose", "--json"}


class ShareTransport(StreamTransport):
    """Session with a hub, which repeats lost requests and keeps the responses of programs apart."""

    is_shared = True
    dead_man: ClassVar[float | None] = None
    """Seconds of a silent event loop after which hubs stop what this process moves; None for no limit."""

    def __init__(self, url: str, name: str, greeting: Greeting) -> None:
        """Lead to the board that is shared as `name`. `greeting` may be changed until the hub is greeted."""
        super().__init__(url)
        self.greeting = greeting
        self.welcome: Welcome | None = None
        """Welcome of the hub; None before `greet` or `open`."""
        self._name = name

    @property
    def board_url(self) -> str:
        """The address of the board behind the hub; that of the hub before `greet`."""
        return self.url if self.welcome is None else self.welcome.url

    async def greet(self) -> Welcome:
        """Connect to the hub, unless connected, and return the welcome; `open` can follow. Raise OpenError."""
        if self.welcome is None:
            self._pipe, self.welcome = await greet(self._name, self.greeting, self, url=self.url)
        return self.welcome

    async def connect(self) -> asyncio.Transport:
        """Greet the hub; OpenError says what to do."""
        await self.greet()
        assert self._pipe is not None  # noqa: S101 - narrows the type
        return self._pipe

    async def _open(self) -> None:
        await super()._open()
        if self._pipe is not None:
            self._pipe.resume_reading()


async def greet(
    name: str, greeting: Greeting, protocol: asyncio.Protocol, *, url: str = ""
) -> tuple[asyncio.Transport, Welcome]:
    """Connect to the hub `name` and exchange greetings; return the connection and what the hub said.

    From then on it belongs to `protocol`, and brings nothing before `resume_reading`. Raise OpenError, which says what
    to do and calls the hub `url`, and leave nothing open.
    """
    url = url or f"share://{name}"
    listener = _Listener()
    limit = asyncio.timeout(_WELCOME_LIMIT)
    try:
        async with limit:
            pipe, greeting.token = await connect_locally(name, lambda: listener)
            pipe.write(msgspec.json.encode(greeting) + b"\n")
            welcome = _read_welcome(await listener.line)
    except (OSError, ValueError) as error:
        listener.abort()
        why = f"the hub did not answer within {_WELCOME_LIMIT:g} s" if limit.expired() else _explain(name, error)
        raise OpenError(f"{url}: {why}") from error
    except BaseException:
        listener.abort()
        raise
    pipe.set_protocol(protocol)
    return pipe, welcome


class _Listener(asyncio.Protocol):
    """Protocol waiting for a single line of text."""

    def __init__(self) -> None:
        self.line: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        self._heard = bytearray()
        self._pipe: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - narrows the type
        self._pipe = transport

    def data_received(self, data: bytes) -> None:
        self._heard += data
        if (self._heard.endswith(b"\n") or len(self._heard) > _MOST_WELCOME) and self._pipe is not None:
            self._pipe.pause_reading()  # a hub sends nothing more before a request
            self.line.set_result(bytes(self._heard))

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.line.done():
            self.line.set_exception(exc or ConnectionResetError("the hub closed the connection; perhaps it is ending"))
            self.line.exception()  # retrieved, even if no caller waits any more

    def abort(self) -> None:
        if self._pipe is not None:
            self._pipe.abort()


def _read_welcome(line: bytes) -> Welcome:
    """Return the welcome of the hub. Raise ValueError for a refusal or any other message."""
    with suppress(msgspec.DecodeError):
        raise ValueError(f"the hub refuses: {msgspec.json.decode(line, type=Refusal).error}")
    try:
        welcome = msgspec.json.decode(line, type=Welcome)
    except msgspec.MsgspecError as error:
        raise ValueError(f"what listens there is not a hub: {error}") from error
    if welcome.servolink != VERSION:
        raise ValueError(f"the hub has version {welcome.servolink} of its protocol, not {VERSION}: update servolink")
    return welcome


def _explain(name: str, error: Exception) -> str:
    if isinstance(error, FileNotFoundError | ConnectionRefusedError):
        return f"no hub of this name is running; `servolink share --name {name}` starts it, `servolink list` shows all"
    return reason(error)


def this_program() -> str:
    """Return a name of this program for people, such as `servolink watch (pid 1234)`."""
    path = Path(sys.argv[0] if sys.argv else "")
    name = path.parent.name if path.name == "__main__.py" else path.name or "python"
    if name == "servolink":
        name = " ".join(["servolink", *_command(sys.argv[1:])])
    return f"{escape(name)[:_MOST_WHO]} (pid {os.getpid()})"


def _command(words: Sequence[str]) -> list[str]:
    """Return the command among the words of a command line: the first that is not an option, nor the value of one."""
    pairs = zip(["", *words], words, strict=False)
    found = (word for before, word in pairs if word.isalpha() and (not before.startswith("-") or before in _FLAGS))
    return list(islice(found, 1))


def from_address(address: Address) -> ShareTransport:
    """Make the transport for `share://NAME?role=watch`."""
    if not is_name(address.host) or address.port or address.path.strip("/"):
        raise address.refusal("must name a shared board: share://NAME, with letters, digits, - and _")
    role = cast("RoleName", address.choice("role", "edit", tuple(map(str, Role))))
    address.refuse_unknown()
    greeting = Greeting(wants="frames", who=this_program(), role=role)
    if address.choice("byte_order", "little", ("little", "big")) == "big":
        greeting.byte_order = "big"
    return ShareTransport(address.url, address.host, greeting)
