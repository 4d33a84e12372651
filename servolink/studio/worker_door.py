"""Door of the studio for the page of the same browser, whose worker runs this program: messages over a port.

The worker calls `take` with each message of the page, and passes on what `post` is given. Both carry a kind, the number
of the line, which the page counts up with each connection, and a text:

| from the page | text | to the page | text |
| --- | --- | --- | --- |
| open | greeting of the page | message | message of the studio |
| message | message of the page | close | code and reason, as JSON |
| close | | | |
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import TypeAlias

import msgspec

from servolink.studio.page import OK, Hello, serve_page
from servolink.studio.robots import VIRTUAL, Robots
from servolink.studio.studio_methods import Studio
from servolink.support import Tasks

Post: TypeAlias = Callable[[str, int, str], object]
_NO_GREETING = 4400


async def started(post: Post) -> WorkerDoor:
    """Return the door of a new studio with a virtual robot."""
    studio = Studio(robots=Robots())
    studio.begin(await studio.robots.open(VIRTUAL))
    return WorkerDoor(studio, post)


class WorkerDoor:
    """Lines of the page to the studio, by number."""

    def __init__(self, studio: Studio, post: Post) -> None:
        """Call `post` with each message for the page."""
        self._studio = studio
        self._post = post
        self._lines: dict[int, _PortLine] = {}
        self._tasks = Tasks()

    def take(self, kind: str, number: int, text: str) -> None:
        """Handle a message of the page."""
        match kind:
            case "open":
                self._tasks.begin(self._serve(number, text))
            case "message" if number in self._lines:
                self._lines[number].heard.put_nowait(text)
            case "close" if number in self._lines:
                self._lines[number].heard.put_nowait(None)
            case _:  # a line that the studio has closed meanwhile
                pass

    async def close(self) -> None:
        """Disconnect the page, and give the robots back."""
        await self._tasks.close()
        await self._studio.twin.close()
        await self._studio.robots.close()

    async def _serve(self, number: int, greeting: str) -> None:
        line = self._lines[number] = _PortLine(number, self._post)
        try:
            hello = msgspec.json.decode(greeting, type=Hello)
            with suppress(ConnectionError):
                await serve_page(self._studio, hello, "edit", line)
            await line.close(OK)
        except msgspec.MsgspecError as error:
            await line.close(_NO_GREETING, str(error))
        finally:
            del self._lines[number]


class _PortLine:
    """Messages of one connection of the page."""

    def __init__(self, number: int, post: Post) -> None:
        self.heard = asyncio.Queue[str | None]()
        self._number = number
        self._post = post
        self._is_open = True

    async def receive(self) -> str | None:
        """Return the next message; None once the page has left."""
        return await self.heard.get()

    async def send(self, text: str) -> None:
        """Post a message to the page."""
        if not self._is_open:
            raise ConnectionError("the page has left")
        self._post("message", self._number, text)

    async def close(self, code: int, why: str = "") -> None:
        """Tell the page, once, that its connection has ended."""
        if self._is_open:
            self._is_open = False
            self._post("close", self._number, msgspec.json.encode({"code": code, "reason": why}).decode())
