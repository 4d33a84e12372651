"""Door for programs with servolink: `share://NAME`, a Unix socket that only this user can open.

`control/greeting.py` has the greeting, `support/platforms/local_sockets.py` systems without such sockets.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from hmac import compare_digest
from typing import Protocol, TypeAlias

import msgspec
from msgspec import Raw

from servolink.boards import HubClaim
from servolink.control import Greeting, Refusal, Role, Welcome
from servolink.errors import OpenError
from servolink.hub.hub import Hub
from servolink.protocol import Codec
from servolink.support import is_same_user, listen_locally, listening_in_memory, reason
from servolink.transports import AcceptedConnection, Strangers

GREETING_LIMIT = 2.0
"""Seconds until a program without a greeting is disconnected."""
MOST_MESSAGE = 1024 * 1024
"""Most bytes of a JSON-RPC message."""


class Channel(Protocol):
    """Receiver of the messages of a connection in JSON-RPC."""

    def receive(self, message: bytes, /) -> None:
        """Process one message without raising."""

    def pause(self) -> None:
        """Send as little as possible: the program does not read."""

    def resume(self) -> None:
        """Send as usual: the program reads again."""

    async def close(self) -> None:
        """End every request: the connection is gone."""


OpenChannel: TypeAlias = Callable[[Hub, Greeting, str, Callable[[bytes], None], Callable[[str], None]], Channel]
"""Function of hub, greeting, session id, and functions to send a message and to disconnect with a reason."""


@asynccontextmanager
async def socket_door(hub: Hub, claim: HubClaim, open_channel: OpenChannel | None = None) -> AsyncIterator[str]:
    """Serve programs at the address of the claimed name within this context; yield the URL. Raise OpenError."""
    with listening_in_memory(claim.name, partial(ShareConnection, hub, open_channel, "")) as is_listening:
        if is_listening:
            yield claim.url
            return
    try:
        door = listen_locally(claim.name)
    except OSError as error:
        raise OpenError(f"{claim.url}: no program could connect: {reason(error)}") from error
    try:
        # Strangers of its own: those from the network must not take the place of a local program that is to stop.
        local = Strangers()
        make = partial(ShareConnection, hub, open_channel, door.token)
        async with AcceptedConnection.serving([door.listening], make, strangers=local):
            yield claim.url
    finally:
        with suppress(OSError):
            door.path.unlink()


class ShareConnection(AcceptedConnection):
    """Connection that begins with a greeting, and then carries frames or JSON-RPC."""

    def __init__(self, hub: Hub, open_channel: OpenChannel | None, token: str) -> None:
        """Admit a program whose greeting is right and has the `token`."""
        super().__init__()
        self._hub = hub
        self._open_channel = open_channel
        self._token = token
        self._text = bytearray()
        self._limit = self._loop.call_later(GREETING_LIMIT, self._refuse, f"no greeting within {GREETING_LIMIT:g} s")

    def _begin(self, data: bytes) -> None:
        self._text += data
        line, end, rest = bytes(self._text).partition(b"\n")
        if not end and len(line) <= Greeting.MOST_BYTES:
            return
        self._limit.cancel()
        try:
            greeting = _read_greeting(line, self._token)
            self._welcome(greeting)
        except ValueError as error:
            self._refuse(str(error))
            return
        if rest:
            self._receive(rest)

    def _welcome(self, greeting: Greeting) -> None:
        """Admit the program. Raise ValueError for an invalid greeting."""
        role = Role.parse(greeting.role)
        self.who = greeting.who
        if greeting.wants == "frames":
            if greeting.session is not None:
                raise ValueError("a session begins with its frames; they have no session yet")
            if greeting.dead_man is not None:  # frames cannot say that the program still watches
                raise ValueError("frames have no dead-man time: take the lease with it on a connection for rpc")
            codec = Codec(greeting.byte_order, self._hub.board.codec.caption_encoding)
            program = self._hub.join(
                self.send, who=greeting.who, door="share", role=role, codec=codec, unit=greeting.angle_unit
            )
            program.on_end = self.end
            self._join(program)
            self._say(self._introduction(program.session_id, greeting))
            return
        if self._open_channel is None:
            raise ValueError("this hub has no control interface")
        session = greeting.session or secrets.token_hex(16)
        if greeting.session is not None and greeting.session not in self._hub.programs:
            raise ValueError("there is no such session; perhaps it has ended")
        self._say(self._introduction(session, greeting))
        channel = self._open_channel(self._hub, greeting, session, self._send_message, self.abort)
        self._join(Messages(channel, self.abort), is_bounded=True)  # the channel counts unread messages

    def _introduction(self, session: str, greeting: Greeting) -> Welcome:
        board = self._hub.board
        profile = None if board.profile is None else board.profile.profile
        return Welcome(
            servolink=Welcome.VERSION,
            session=session,
            name=self._hub.name,
            url=self._hub.url,
            role=greeting.role,
            patience=board.connection.patience,
            has_control=self._open_channel is not None,
            has_forecast=self._hub.forecast is not None,
            profile=Raw(msgspec.json.encode(profile)),
            lease=Raw(msgspec.json.encode(self._hub.lease)),
            hold=Raw(msgspec.json.encode(self._hub.status().hold)),
            stops=self._hub.stops.count,
        )

    def _refuse(self, why: str) -> None:
        self._limit.cancel()
        if self._pipe is not None and not self._pipe.is_closing():
            self._say(Refusal(why))
            self._pipe.close()

    def _say(self, line: Welcome | Refusal) -> None:
        self._send_message(msgspec.json.encode(line))

    def _send_message(self, message: bytes) -> None:
        self._write(message + b"\n")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Disconnect other users, for whom the folder of the socket is closed."""
        super().connection_made(transport)
        if not is_same_user(transport.get_extra_info("socket")):
            self.abort("it belongs to another user")

    def connection_lost(self, exc: Exception | None) -> None:
        """End the session."""
        self._limit.cancel()
        super().connection_lost(exc)


class Messages:
    """Handler of a program with JSON-RPC, a message in each line."""

    is_full = False
    waiting = 0

    def __init__(self, channel: Channel, abort: Callable[[str], None]) -> None:
        """Pass messages to `channel`; call `abort` with the reason for a message over the limit."""
        self.on_room: Callable[[], None] | None = None
        self.pause, self.resume = channel.pause, channel.resume
        self._channel = channel
        self._abort = abort
        self._text = bytearray()
        self._closing: asyncio.Task[None] | None = None

    def receive(self, data: bytes, /) -> None:
        """Collect bytes, and pass on each complete message."""
        self._text += data
        if b"\n" in data:
            *messages, self._text = self._text.split(b"\n")
            for message in messages:
                self._channel.receive(bytes(message))
        elif len(self._text) > MOST_MESSAGE:
            self._abort(f"its message is longer than {MOST_MESSAGE >> 20} MiB")

    def leave(self) -> None:
        """Close the channel: the program is gone."""
        self._closing = asyncio.get_running_loop().create_task(self._channel.close())


def _read_greeting(line: bytes, token: str) -> Greeting:
    """Return the greeting of a program. Raise ValueError with the reason for a refusal."""
    greeting = Greeting.read(line)
    if token and not compare_digest(greeting.token.encode(), token.encode()):
        raise ValueError("wrong token: read it from the private file of this hub")
    return greeting
