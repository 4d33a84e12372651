"""Open page: sends a token, then speaks the control interface of the hub and the methods of the studio."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from hashlib import sha256
from typing import Annotated, Any, Protocol

import msgspec
from msgspec import Meta, Struct

from servolink.boards import BoardProfile, ProfileInUse
from servolink.control import Greeting, Origin, Peer, Role, RoleName, Touches, Welcome, greet
from servolink.errors import OpenError
from servolink.hub import METHODS as HUB_METHODS
from servolink.studio import (  # modules that add their methods on import
    block_methods,
    board_methods,
    draft_methods,
    figure_methods,
    limit_methods,
    project_methods,
    recording_methods,
    robot_methods,
    twin_methods,
)
from servolink.studio.studio_methods import METHODS, MOST_NAME, PageCaller, Studio
from servolink.support import read_json
from servolink.transports import Pace

__all__ = [
    "MOST_MESSAGE",
    "MOST_UNREAD",
    "block_methods",
    "board_methods",
    "draft_methods",
    "figure_methods",
    "limit_methods",
    "project_methods",
    "recording_methods",
    "robot_methods",
    "serve_page",
    "twin_methods",
]

MOST_MESSAGE = Peer.MOST_BYTES
MOST_UNREAD = 64
"""Most unread messages of the studio to a page; beyond the limit, only the necessary ones are sent."""
_MOST_LINE = 8 * Peer.MOST_BYTES  # bytes in a line of the hub
OK, NO_HUB, MOVING = 1000, 4404, 4410
"""Codes with which a page is disconnected: at the end, without a hub, and as the studio goes on to another board."""
_OWN = "studio."
_STOPS = ("stop", "studio.stop", "studio.fleet.stop")
_REFUSED = {name: method for name, method in HUB_METHODS.items() if Touches.HOST in method.scope.touches}
"""Methods of the hub that are refused to links."""


class Hello(Struct, forbid_unknown_fields=True):
    """The first message of a page."""

    token: Annotated[str, Meta(max_length=200)]
    who: Annotated[str, Meta(max_length=MOST_NAME)] = ""
    """Name of the page for people, such as `Tablet 2`."""
    leaves: bool = False
    """Whether the studio is to leave its board: the hub has ended, and another robot is to be chosen."""


class _Named(Struct):
    """Part of a message that decides about forwarding."""

    method: str = ""


class Line(Protocol):
    """Messages to a page and back, whatever carries them."""

    async def receive(self) -> str | None:
        """Return the next message of the page; None once the page is gone."""
        ...

    async def send(self, text: str) -> None:
        """Send a message. Raise ConnectionError if the page is gone."""

    async def close(self, code: int, why: str = "") -> None:
        """Disconnect the page, with a code and a reason of at most 120 bytes."""


async def serve_page(studio: Studio, hello: Hello, role: RoleName, line: Line, *, is_link: bool = False) -> None:
    """Talk with an admitted page until it is closed, or the hub ends."""
    try:
        if hello.leaves and role == "edit" and not is_link:
            await studio.use("", hello.who)
        async with _connected(studio, hello, role) as (welcome, reader, writer):
            first = await studio.welcome(welcome, is_link=is_link)
            await line.send(msgspec.json.encode(first).decode())
            await _Page(studio, role, hello, welcome, line, reader, writer, is_link=is_link).talk()
    except OpenError as error:
        await line.close(NO_HUB, str(error))


@asynccontextmanager
async def _connected(
    studio: Studio, hello: Hello, role: RoleName
) -> AsyncIterator[tuple[Welcome, asyncio.StreamReader, asyncio.StreamWriter | None]]:
    """Connect to the control interface of the hub for a page. Raise OpenError if there is no hub.

    Without a board, the page has no hub: there is no writer, and the reader stays silent.
    """
    reader = asyncio.StreamReader(limit=_MOST_LINE)
    if not studio.hub:
        yield Welcome(servolink=Welcome.VERSION, session="", name="", url="", role=role), reader, None
        return
    protocol = asyncio.StreamReaderProtocol(reader)
    group = sha256(hello.token.encode()).hexdigest()
    greeting = Greeting(wants="rpc", who=_name_for_hub(hello.who), role=role, group=group)
    pipe, welcome = await greet(studio.hub, greeting, protocol)
    protocol.connection_made(pipe)
    writer = asyncio.StreamWriter(pipe, protocol, reader, asyncio.get_running_loop())
    pipe.resume_reading()
    try:
        yield welcome, reader, writer
    finally:
        pipe.abort()  # so that the hub ends the page's lease at once


class _Page:
    """Carries messages between a page and the hub."""

    def __init__(
        self,
        studio: Studio,
        role: RoleName,
        hello: Hello,
        welcome: Welcome,
        line: Line,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter | None,
        *,
        is_link: bool,
    ) -> None:
        self._line = line
        self._reader = reader
        self._writer = writer
        self._pace = Pace(studio.turns[hello.token])
        self._responses: asyncio.Queue[bytes | None] = asyncio.Queue()  # None ends the conversation
        self._ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._code = OK
        self._studio = studio
        self.token = hello.token
        self.is_link = is_link
        self.who = hello.who
        self.hub = welcome.name
        caller = PageCaller(studio, welcome.url, self, welcome.name, _profile_in(welcome))
        methods: dict[str, Any] = {**_REFUSED, **METHODS} if is_link else {**METHODS}
        origin = Origin.LINK if is_link else Origin.HERE
        reading = studio.readings[hello.token]
        self._own = Peer(
            methods,
            lambda: caller,
            self._respond,
            self._abort,
            role=Role.parse(role),
            origin=origin,
            reading=reading,
        )

    async def talk(self) -> None:
        """Carry messages until one side ends."""
        tasks = [asyncio.ensure_future(each) for each in (self._from_page(), self._from_hub(), self._from_studio())]
        self._studio.pages.add(self)
        if self.is_link and not self._studio.is_link(self.token):  # revoked while the page connected
            self.close()
        if self.hub != self._studio.hub:  # changed while the page connected
            self.leave()
        try:
            await asyncio.wait((*tasks, self._ended), return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._studio.pages.discard(self)
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
            await self._own.close()
        await self._line.close(self._code)

    async def _from_page(self) -> None:
        while (text := await self._line.receive()) is not None:
            await self._pace.keep(len(text), is_stop=len(text) < Peer.LARGE and _method(text) in _STOPS)
            if self._writer is None or not self._is_for_hub(_method(text)):
                self._own.receive(text)
            else:
                # A line for each message; line breaks in JSON occur only between values.
                self._writer.write(text.replace("\n", " ").replace("\r", " ").encode("utf-8", "surrogatepass") + b"\n")
                await self._writer.drain()

    def _is_for_hub(self, method: str) -> bool:
        """Return whether the hub carries out a method; through a link, not an undeclared one of a later hub."""
        if method in METHODS or method.startswith(_OWN):
            return False
        return not self.is_link or (method in HUB_METHODS and method not in _REFUSED)

    async def _from_hub(self) -> None:
        with suppress(ConnectionError, ValueError):  # ValueError: a line that is too long
            while line := await self._reader.readline():
                await self._line.send(line.decode())

    async def _from_studio(self) -> None:
        with suppress(ConnectionError):
            while (response := await self._responses.get()) is not None:
                await self._line.send(response.decode())
                if self._own.is_paused and self._responses.empty():
                    self._own.resume()

    def _respond(self, response: bytes) -> None:
        self._responses.put_nowait(response)
        if self._responses.qsize() >= MOST_UNREAD:
            self._own.pause()

    def rename(self, who: str) -> None:
        """Rename the page to `who`, in the hub too."""
        self.who = who
        if self._writer is None:
            return
        params = {"who": _name_for_hub(who)}
        self._writer.write(msgspec.json.encode({"jsonrpc": "2.0", "method": "rename", "params": params}) + b"\n")

    def notify(self, name: str, params: Struct) -> None:
        """Send a notification of the studio."""
        self._own.notify(name, params)

    def close(self) -> None:
        """Close the page's session; the hub stops motions of the page."""
        self._abort("")

    def leave(self) -> None:
        """Disconnect after the messages that wait, so that the page connects again, to another board."""
        self._code = MOVING
        self._responses.put_nowait(None)

    def _abort(self, _reason: str) -> None:
        if self._writer is not None:
            self._writer.transport.abort()
        if not self._ended.done():
            self._ended.set_result(None)


def _name_for_hub(who: str) -> str:
    return f"studio: {who or 'a page'}"


def _profile_in(welcome: Welcome) -> ProfileInUse | None:
    """Return the profile of the board; None without a profile, or with a profile of another version of servolink."""
    with suppress(msgspec.MsgspecError):
        found = msgspec.json.decode(welcome.profile, type=BoardProfile | None)
        return None if found is None else ProfileInUse(welcome.name, found)
    return None


def _method(text: str) -> str:
    """Return the method called by a message; empty if unreadable: the hub then answers with the error."""
    try:
        return msgspec.json.decode(text, type=_Named).method
    except (msgspec.MsgspecError, RecursionError):  # such as a caption with bytes outside UTF-8: decoded less strictly
        with suppress(ValueError, RecursionError):
            value = read_json(text)
            method = value.get("method") if isinstance(value, dict) else None
            return method if isinstance(method, str) else ""
        return ""
