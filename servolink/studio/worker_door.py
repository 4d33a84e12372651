"""Door of the studio for the page of the same browser, whose worker runs this program: messages over a port.

The worker calls `take` with each message of the page, and passes on what `post` is given. Both carry a kind, the number
of the line, which the page counts up with each connection, and a text:

| from the page | text | to the page | text |
| --- | --- | --- | --- |
| open, or watch | greeting of a page that edits, or watches | message | message of the studio |
| message | message of the page | close | code and reason, as JSON |
| close | | refused | why the board of before cannot be opened; number 0 |
| program.end | | | |

Kinds that begin with `port.` are for the ports of the page (`servolink/transports/page_ports.py`). A program in another
worker has a separate port (`program_pipes.py`) from `join` to `program.end`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import TypeAlias

import msgspec

from servolink.control import RoleName
from servolink.errors import DecodeError, ServolinkError
from servolink.protocol import ALL_SERVOS, PACKETS, ByteOrder, Codec, FrameAt, SetServoParameterRequest
from servolink.studio.page import OK, Hello, serve_page
from servolink.studio.program_pipes import PortPipes
from servolink.studio.robots import VIRTUAL, Robots
from servolink.studio.studio_methods import Studio
from servolink.support import Tasks, connect_locally
from servolink.transports import PagePorts

Post: TypeAlias = Callable[[str, int, str], object]
_NO_GREETING = 4400
_STOP_PAUSE = 0.1  # seconds
_CODECS: dict[ByteOrder, Codec] = {"little": Codec("little"), "big": Codec("big")}
_STOPS = {order: codec.encode(SetServoParameterRequest(ALL_SERVOS, 0, 1)) for order, codec in _CODECS.items()}


class BoardFrames:
    """Meaning of frames for the page, which stops servos by itself."""

    def may_move(self, frame: bytes) -> bool:
        """Return whether servos may turn or go limp by `frame`; True for what cannot be decoded."""
        order = _order_of(frame)
        whole = FrameAt.read(frame, 0, order)
        if whole is None or whole.size != len(frame):
            return True
        try:
            return _CODECS[order].decode(whole.packet_id, whole.content).is_motion
        except DecodeError:
            return True

    def stop_for(self, frame: bytes) -> bytes:
        """Return the frame that stops all servos, in the byte order of `frame`."""
        return _STOPS[_order_of(frame)]


def _order_of(frame: bytes) -> ByteOrder:
    """Return the byte order in which `frame` is a packet; `little` for no packet."""
    big = FrameAt.read(frame, 0, "big")
    return "big" if big is not None and big.size == len(frame) and big.packet_id in PACKETS else "little"


class WorkerDoor:
    """Studio for the page of the same browser: lines of the page, by number, and its ports."""

    def __init__(self, post: Post) -> None:
        """Call `post` with each message for the page."""
        self._studio = Studio(robots=Robots())
        self._begun = asyncio.Event()
        self._post = post
        self._lines: dict[int, _PortLine] = {}
        self._programs: dict[int, PortPipes] = {}
        self._tasks = Tasks()
        PagePorts.here = self._ports = PagePorts(post, BoardFrames(), lambda: self._tasks.begin(self._stop()))

    async def begin(self, address: str = "") -> None:
        """Share the board at `address`; a virtual robot without an address, or if the board cannot be opened."""
        try:
            hub = await self._studio.robots.open(address or VIRTUAL)
        except ServolinkError as error:
            self._post("refused", 0, str(error))
            hub = await self._studio.robots.open(VIRTUAL)
        self._studio.begin(hub)
        self._begun.set()

    def take(self, kind: str, number: int, text: str) -> None:
        """Handle a message of the page."""
        if kind.startswith("port."):
            self._ports.take(kind, number, text)
            return
        match kind:
            case "open" | "watch":
                self._tasks.begin(self._serve(number, text, "edit" if kind == "open" else "watch"))
            case "message" if number in self._lines:
                self._lines[number].heard.put_nowait(text)
            case "close" if number in self._lines:
                self._lines[number].heard.put_nowait(None)
            case "program.end" if number in self._programs:
                self._tasks.begin(self._programs.pop(number).close())
            case _:  # a line that the studio has closed meanwhile
                pass

    def join(self, number: int, post: Post) -> None:
        """Connect a program in another worker with the hub; call `post` with messages for the program."""
        self._programs[number] = PortPipes(post, self._connect)
        self._tasks.begin(self._introduce(post))

    def hear(self, number: int, kind: str, pipe: int, text: str) -> None:
        """Handle a message of a program."""
        if number in self._programs:
            self._programs[number].hear(kind, pipe, text)

    async def close(self) -> None:
        """Disconnect the page and its programs, and give the robots back."""
        PagePorts.here = None
        for pipes in self._programs.values():
            await pipes.close()
        await self._tasks.close()
        await self._studio.twin.close()
        await self._studio.robots.close()

    async def _introduce(self, post: Post) -> None:
        await self._begun.wait()
        post("hub", 0, self._studio.hub)

    async def _connect(self, make_protocol: Callable[[], asyncio.Protocol]) -> None:
        await connect_locally(self._studio.hub, make_protocol)

    async def _stop(self) -> None:
        """Stop the board, which the page has stopped already: what was asked for before is not sent any more.

        The response to each stop of the page needs a slot of the connection.
        """
        while self._ports.stops_behind and self._studio.hub in self._studio.robots:
            with suppress(ServolinkError):  # the page calls `stop` too, and gets the error
                await self._studio.robots.stop(self._studio.hub, self._ports.stops_behind)
            await asyncio.sleep(_STOP_PAUSE)

    async def _serve(self, number: int, greeting: str, role: RoleName) -> None:
        line = self._lines[number] = _PortLine(number, self._post)
        try:
            hello = msgspec.json.decode(greeting, type=Hello)
            hello.token = role  # each role has turns of its own
            await self._begun.wait()
            with suppress(ConnectionError):
                await serve_page(self._studio, hello, role, line)
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
