"""Ports held by the page of a browser whose worker runs this program; messages carry their bytes.

A message has a kind, the number of an open port, and a text. Bytes are characters from 0 to 255.

| to the page | text | from the page | text |
| --- | --- | --- | --- |
| port.open | address and options, as JSON | port.opened | stop epoch |
| | | port.failed | reason: `absent`, `in use`, `other tab`, or that of the browser |
| port.frame | epoch, `!` if it may move servos, space, bytes | port.sent | bytes accepted or dropped so far |
| port.stop | frame that stops all servos | port.stopped | new epoch, after the page has written that frame |
| | | port.data | bytes |
| port.close | | port.lost | |
| | | port.closed | |
| | | port.list | ports granted to the page, as JSON; number 0 |

STOP does not wait for this program: the page writes the stop frame, and drops frames of older epochs that may move
servos. The connection then sends its own stop for each stop of the page; these are not written again, and frames after
them carry the new epoch.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import count
from typing import ClassVar, NamedTuple, Protocol, TypeAlias

import msgspec

from servolink.errors import ConnectionLost, OpenError, TransportUnavailable
from servolink.transports.address import Address
from servolink.transports.device_info import DeviceInfo, PortIdentity
from servolink.transports.lifecycle import BaseTransport

Post: TypeAlias = Callable[[str, int, str], object]
_HIGH = 4096  # unsent bytes above which a sender waits
_DRAIN_LIMIT = 0.4  # seconds for sent bytes to leave in `close`
_END_LIMIT = 0.5  # seconds for the page to close the port after that
_HOLD_LIMIT = 1.0  # seconds for which received bytes wait for the stop of the connection
_GONE = "the device is gone; is it unplugged or switched off?"
_REASONS = {
    "absent": "the browser has no such port for this page; plug the board in, or choose it with `Connect my robot`",
    "in use": "the port is in use; close the program that has it (another servolink, a serial monitor)",
    "other tab": "another tab of this browser has the robot; close that tab",
}
"""Texts for the reasons of the page; a reason without a text is that of the browser."""


class Frames(Protocol):
    """Meaning of frames, which transports do not know."""

    def may_move(self, frame: bytes) -> bool:
        """Return whether servos may turn or go limp by `frame`."""
        ...

    def stop_for(self, frame: bytes) -> bytes:
        """Return the frame that stops all servos, in the byte order of `frame`; any order if `frame` is empty."""
        ...


class _Granted(msgspec.Struct):
    """Port that the person at the browser has granted to the page."""

    url: str
    product: str


class _WaitingSender(NamedTuple):
    """Sender that waits until the browser has accepted bytes."""

    until: int
    accepted: asyncio.Future[bool]


class PagePorts:
    """Ports of the page, by number."""

    here: ClassVar[PagePorts | None] = None
    """Ports of the page that runs this program; None outside a browser."""

    def __init__(self, post: Post, frames: Frames, on_stop: Callable[[], object]) -> None:
        """Call `post` with messages for the page, and `on_stop` when the page has stopped the servos."""
        self.post = post
        self.frames = frames
        self.on_stop = on_stop
        self.granted: tuple[DeviceInfo, ...] = ()
        self._open: dict[int, PagePort] = {}
        self._numbers = count(1)

    @property
    def stops_behind(self) -> int:
        """Stops of the page for which the connection of an open port has not sent a stop yet."""
        return max((port.stops_behind for port in self._open.values()), default=0)

    def take(self, kind: str, number: int, text: str) -> None:
        """Handle a message of the page."""
        if kind == "port.list":
            found = msgspec.json.decode(text, type=list[_Granted])
            self.granted = tuple(DeviceInfo(one.url, one.product, _identity(one.url)) for one in found)
        elif number in self._open:
            self._open[number].hear(kind, text)

    def join(self, port: PagePort) -> int:
        """Return the number of a port that is being opened."""
        number = next(self._numbers)
        self._open[number] = port
        return number

    def forget(self, number: int) -> None:
        """Handle no more messages for a port, which is closed."""
        self._open.pop(number, None)


class PagePort(BaseTransport):
    """Port of the page, opened for one connection."""

    def __init__(self, url: str, page: PagePorts, options: dict[str, int]) -> None:
        """Use the port of `page` at `url`, opened with `options`."""
        super().__init__(url)
        self._page = page
        self._options = options
        self._number = 0
        self._opened: asyncio.Future[None] | None = None
        self._freed: asyncio.Future[None] | None = None
        self._posted = self._sent = 0  # bytes
        self._waiting: deque[_WaitingSender] = deque()
        self._stop = b""
        self._epoch = self._stopped = 0  # of frames that are sent, and of the latest stop of the page
        self._held: list[bytes] = []
        self._holding: asyncio.TimerHandle | None = None

    @property
    def stops_behind(self) -> int:
        """Stops of the page for which the connection has not sent a stop yet."""
        return self._stopped - self._epoch

    def hear(self, kind: str, text: str) -> None:
        """Handle a message of the page for this port."""
        match kind:
            case "port.opened":
                self._epoch = self._stopped = int(text)
                self._settle(None)
            case "port.data" if self._holding is not None:
                self._held.append(text.encode("latin-1"))
            case "port.data":
                self._deliver(text.encode("latin-1"))
            case "port.sent":
                self._note_sent(int(text))
            case "port.stopped":
                self._note_stopped(int(text))
            case "port.failed":
                self._note_freed(OpenError(f"{self.url}: {_REASONS.get(text, text)}"))
            case "port.lost":
                self._note_freed(ConnectionResetError(_GONE))
            case "port.closed":
                self._note_freed(None)

    async def _open(self) -> None:
        loop = asyncio.get_running_loop()
        self._opened, self._freed = loop.create_future(), loop.create_future()
        self._number = self._page.join(self)
        place = self.url.partition("?")[0]
        self._post("port.open", msgspec.json.encode({"url": place, **self._options}).decode())
        self._hand_over(self._page.frames.stop_for(b""))
        try:
            await self._opened
        except asyncio.CancelledError:
            self._end(None)
            await asyncio.wait((self._freed,), timeout=_END_LIMIT)  # or the next attempt finds the port in use
            raise

    def _send(self, data: bytes) -> Awaitable[None] | None:
        if data:
            stop = self._page.frames.stop_for(data)
            if self.stops_behind and data == stop:
                self._epoch += 1
                if not self.stops_behind:
                    asyncio.get_running_loop().call_soon(self._go_on)  # not now: the connection is still sending
                return None
            self._hand_over(stop)
            mark = "!" if self._page.frames.may_move(data) else ""
            self._posted += len(data)
            self._post("port.frame", f"{self._epoch}{mark} {data.decode('latin-1')}")
        if self._posted - self._sent <= (_HIGH if data else 0):
            return None
        accepted = asyncio.get_running_loop().create_future()
        self._waiting.append(_WaitingSender(self._posted, accepted))
        return self._until_accepted(accepted)

    async def _close(self) -> None:
        if self._freed is None:
            return
        try:
            if self._stage == "closing" and (drained := self._send(b"")):
                with suppress(TimeoutError, ConnectionLost):
                    async with asyncio.timeout(_DRAIN_LIMIT):
                        await drained
        finally:
            self._abort()
            self._settle(None)
        await asyncio.wait((self._freed,), timeout=_END_LIMIT)

    def _abort(self) -> None:
        if self._holding is not None:
            self._holding.cancel()
        if self._freed is not None and not self._freed.done():
            self._post("port.close", "")

    def _accepted(self) -> int:
        return self._sent

    def _post(self, kind: str, text: str) -> None:
        self._page.post(kind, self._number, text)

    def _hand_over(self, stop: bytes) -> None:
        """Give the page the frame that stops all servos, if it is another one."""
        if stop != self._stop:
            self._stop = stop
            self._post("port.stop", stop.decode("latin-1"))

    def _settle(self, error: Exception | None) -> None:
        if self._opened is not None and not self._opened.done():
            if error is None:
                self._opened.set_result(None)
            else:
                self._opened.set_exception(error)

    def _note_sent(self, sent: int) -> None:
        self._sent = sent
        while self._waiting and self._waiting[0].until <= sent:
            accepted = self._waiting.popleft().accepted
            with suppress(ValueError):  # ended meanwhile
                self._senders.remove(accepted)
            if not accepted.done():
                accepted.set_result(True)

    def _note_stopped(self, epoch: int) -> None:
        """Keep what is received now until the connection has a place for the response to the stop of the page."""
        self._stopped = epoch
        if self._holding is None:
            self._holding = asyncio.get_running_loop().call_later(_HOLD_LIMIT, self._go_on)
        self._page.on_stop()

    def _go_on(self) -> None:
        if self._holding is not None:
            self._holding.cancel()
            self._holding = None
            held, self._held = b"".join(self._held), []
            if held:
                self._deliver(held)

    def _note_freed(self, error: Exception | None) -> None:
        self._page.forget(self._number)
        if self._freed is not None and not self._freed.done():
            self._freed.set_result(None)
        if self._opened is not None and not self._opened.done():
            self._settle(error)
        elif error is not None:
            self._lose(error)
        else:
            self._end(None)


def candidates() -> list[DeviceInfo]:
    """Return the ports granted to the page; none outside a browser."""
    return [] if PagePorts.here is None else list(PagePorts.here.granted)


def _identity(url: str) -> PortIdentity:
    """Return vendor and product of a port; the number at the end only tells equal ports apart."""
    return msgspec.structs.replace(PortIdentity.from_address(Address.parse(url)), serial_number="")


def from_address(address: Address) -> PagePort:
    """Make the transport for `webserial://VID:PID?baudrate=115200&dtr=0&rts=0`; `/2` for the second such port."""
    page = PagePorts.here
    if page is None:
        raise TransportUnavailable(f"{address.url}: is for the page in a browser; write serial:///dev/ttyACM0 here")
    PortIdentity.from_address(address)
    options = {}
    if address.scheme == "webserial":
        options["baudrate"] = address.integer("baudrate", 115200, 50, 12_000_000)
        options["dtr"] = address.flag("dtr", default=False)
        options["rts"] = address.flag("rts", default=False)
    address.refuse_unknown()
    return PagePort(address.url, page, options)
