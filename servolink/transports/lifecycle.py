"""Notices that the system takes no more bytes, with one timer however many sends wait."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.transports.base import STALL_LIMIT, Receiver, Transport

_STALL_STEP = STALL_LIMIT / 8


class StallWatch:
    """Looks now and then while `waiting()`, and calls `stalled` when `taken()` has not grown for STALL_LIMIT."""

    def __init__(
        self, waiting: Callable[[], bool], taken: Callable[[], int], stalled: Callable[[TimeoutError], None]
    ) -> None:
        """Watch the number `taken()`, which grows with what the system takes."""
        self._waiting = waiting
        self._taken = taken
        self._stalled = stalled
        self._timer: asyncio.TimerHandle | None = None

    @property
    def running(self) -> bool:
        """Whether it has a timer."""
        return self._timer is not None

    def start(self) -> None:
        """Begin, if it has not yet; it ends by itself when nobody waits any more."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, self._taken(), 1)

    def stop(self) -> None:
        """End at once."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self, taken: int, looks: int) -> None:
        """Look for the `looks`-th time whether more than `taken` has been taken."""
        self._timer = None
        if not self._waiting():
            return  # the next send that has to wait starts it again
        if self._taken() != taken:
            taken, looks = self._taken(), 0
        elif looks * _STALL_STEP >= STALL_LIMIT:  # time alone also passes while all of us stand still
            self._stalled(TimeoutError(f"it has taken no byte for {STALL_LIMIT:g} s"))
            return
        self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, taken, looks + 1)


_logger = logging.getLogger(__name__)


class WrappedTransport:
    """Passes everything through both ways, and can break the connection for a reason of its own."""

    def __init__(self, inner: Transport) -> None:
        """Wrap `inner`, which nobody else may use."""
        self._inner = inner
        self._receiver: Receiver | None = None
        self._opened = False
        self._ended = False
        self._cause: Exception | None = None
        self._breaking: asyncio.Task[None] | None = None  # kept, as the loop does not keep its tasks

    @property
    def url(self) -> str:
        """The address of the wrapped transport."""
        return self._inner.url

    async def open(self, receiver: Receiver) -> None:
        """Open the wrapped transport."""
        self._check_unused()
        self._receiver = receiver
        await self._inner.open(self)
        self._opened = True

    async def send(self, data: bytes) -> None:
        """Send all of `data`, or raise ConnectionLost."""
        self._check_open()
        await self._inner.send(data)

    async def close(self) -> None:
        """Close the wrapped transport."""
        await self._inner.close()
        self._ended = True

    def data(self, chunk: bytes, /) -> None:
        """Take what the wrapped transport brings."""
        self._deliver(chunk)

    def lost(self, error: Exception | None, /) -> None:
        """Take note that the wrapped transport has ended."""
        self._end(error)

    def _check_unused(self) -> None:
        if self._receiver is not None or self._ended:
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")

    def _check_open(self) -> None:
        if self._cause is not None:
            raise ConnectionLost(*self._cause.args) from self._cause
        if self._ended or not self._opened:
            raise ConnectionLost(f"{escape(self.url)}: it is {'closed' if self._ended else 'not open yet'}")

    def _deliver(self, chunk: bytes) -> None:
        if self._receiver is not None and not self._ended:
            self._receiver.data(chunk)

    def _break(self, reason: str) -> None:
        """Lose the connection now, and close the wrapped transport behind it."""
        if not self._ended:
            self._breaking = asyncio.ensure_future(self._inner.close())
            self._breaking.add_done_callback(self._broken)
            self._end(ConnectionLost(f"{escape(self.url)}: the connection was lost: {reason}"))

    def _broken(self, closing: asyncio.Task[None]) -> None:
        if not closing.cancelled() and (error := closing.exception()):  # nobody waits for it to be told
            _logger.warning("%s: closing it failed: %s", escape(self.url), escape(str(error)))

    def _end(self, error: Exception | None) -> None:
        if not self._ended and self._receiver is not None:
            self._ended = True
            self._cause = error
            self._receiver.lost(error)
