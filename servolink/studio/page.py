"""Open page: sends a token, then speaks the control interface of the hub and the methods of the studio."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Annotated

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web
from msgspec import Meta, Struct

from servolink.control.greeting import VERSION, Greeting, Welcome
from servolink.control.peer import MOST_BYTES, Peer
from servolink.control.roles import Role, RoleName
from servolink.control.share_address import greet
from servolink.errors import OpenError
from servolink.json_text import read_json
from servolink.profiles.profile import BoardProfile, ProfileInUse
from servolink.studio import (  # modules that add their methods on import
    block_methods,
    board_methods,
    draft_methods,
    figure_methods,
    firmware_methods,
    fleet_methods,
    limit_methods,
    project_methods,
    recording_methods,
    robot_methods,
    twin_methods,
)
from servolink.studio.gate import Gate
from servolink.studio.studio_methods import METHODS, MOST_NAME, PageCaller, Studio

__all__ = [
    "MOST_MESSAGE",
    "MOST_UNREAD",
    "block_methods",
    "board_methods",
    "draft_methods",
    "figure_methods",
    "firmware_methods",
    "fleet_methods",
    "limit_methods",
    "project_methods",
    "recording_methods",
    "robot_methods",
    "serve_page",
    "twin_methods",
]

MOST_MESSAGE = MOST_BYTES
MOST_UNREAD = 64
"""Most unread messages of the studio to a page; beyond the limit, only the necessary ones are sent."""
_TOKEN_LIMIT = 5.0  # seconds for the first message
_MOST_LINE = 8 * MOST_BYTES  # bytes in a line of the hub
_BAD_TOKEN, _NO_HUB, _MOVING = 4401, 4404, 4410  # codes for closing the socket
_OWN = "studio."


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


async def serve_page(studio: Studio, gate: Gate, messages: web.WebSocketResponse, admit: Callable[[], None]) -> None:
    """Talk with a page until it is closed, or the hub ends; call `admit` when it shows a token."""
    hello = await _hello(messages)
    role = None if hello is None else gate.role_of(hello.token)
    if hello is None or role is None:
        await messages.close(code=_BAD_TOKEN, message=b"open the address that the studio prints")
        return
    admit()
    is_link = studio.is_link(hello.token)
    try:
        if hello.leaves and role == "edit" and not is_link:
            await studio.use("", hello.who)
        async with _connected(studio, hello.who, role) as (welcome, reader, writer):
            first = await studio.welcome(welcome, is_link=is_link)
            await messages.send_str(msgspec.json.encode(first).decode())
            await _Page(studio, role, hello, welcome, messages, reader, writer, is_link=is_link).talk()
    except OpenError as error:
        await messages.close(code=_NO_HUB, message=str(error).encode()[:120])


async def _hello(messages: web.WebSocketResponse) -> Hello | None:
    with suppress(TimeoutError, msgspec.MsgspecError, TypeError):
        return msgspec.json.decode(await messages.receive_str(timeout=_TOKEN_LIMIT), type=Hello)
    return None


@asynccontextmanager
async def _connected(
    studio: Studio, who: str, role: RoleName
) -> AsyncIterator[tuple[Welcome, asyncio.StreamReader, asyncio.StreamWriter | None]]:
    """Connect to the control interface of the hub for a page. Raise OpenError if there is no hub.

    Without a board, the page has no hub: there is no writer, and the reader stays silent.
    """
    reader = asyncio.StreamReader(limit=_MOST_LINE)
    if not studio.hub:
        yield Welcome(servolink=VERSION, session="", name="", url="", role=role), reader, None
        return
    protocol = asyncio.StreamReaderProtocol(reader)
    greeting = Greeting(wants="rpc", who=_name_for_hub(who), role=role)
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
        messages: web.WebSocketResponse,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter | None,
        *,
        is_link: bool,
    ) -> None:
        self._messages = messages
        self._reader = reader
        self._writer = writer
        self._responses: asyncio.Queue[bytes | None] = asyncio.Queue()  # None ends the conversation
        self._ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._code: int = WSCloseCode.OK
        self._studio = studio
        self.token = hello.token
        self.is_link = is_link
        self.who = hello.who
        self.hub = welcome.name
        caller = PageCaller(studio, welcome.url, self, welcome.name, _profile_in(welcome))
        self._own = Peer(METHODS, lambda: caller, self._respond, self._abort, role=Role.parse(role))

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
        await self._messages.close(code=self._code)

    async def _from_page(self) -> None:
        async for message in self._messages:
            if message.type is not WSMsgType.TEXT:
                return
            text: str = message.data
            if self._writer is None or (method := _method(text)) in METHODS or method.startswith(_OWN):
                self._own.receive(text)
            else:
                # A line for each message; line breaks in JSON occur only between values.
                self._writer.write(text.replace("\n", " ").replace("\r", " ").encode("utf-8", "surrogatepass") + b"\n")
                await self._writer.drain()

    async def _from_hub(self) -> None:
        with suppress(ConnectionError, ValueError):  # ValueError: a line that is too long
            while line := await self._reader.readline():
                await self._messages.send_str(line.decode())

    async def _from_studio(self) -> None:
        with suppress(ConnectionError):
            while (response := await self._responses.get()) is not None:
                await self._messages.send_str(response.decode())
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
        self._code = _MOVING
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
