"""Life cycle shared by all kinds of transports: opened once, lost once, closed any number of times."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Literal, TypeAlias

from servolink.errors import ConnectionLost, OpenError, ServolinkError, escape
from servolink.transports.base import STALL_LIMIT, Receiver, Transport

_logger = logging.getLogger("servolink.transport")

_STALL_STEP = STALL_LIMIT / 8

Stage: TypeAlias = Literal["new", "opening", "open", "closing", "ended"]


class BaseTransport(ABC):
    """Contract of a transport without the bytes: each kind implements `_open`, `_send`, `_close` and `_abort`.

    A kind calls `_deliver` with each received chunk, and `_lose` with the error that ends the connection. Other
    exceptions than ServolinkError become OpenError or ConnectionLost, so that a kind need not translate the errors of
    its library.
    """

    takes_at_once = True
    """Whether `take` has queued all data at its return, awaited or not."""
    is_recorded = False
    """Whether sent bytes are recorded or compared with a recording, and must not depend on chance."""
    is_shared = False
    """Whether the peer is a hub, which repeats requests and separates programs."""

    def __init_subclass__(cls) -> None:
        """Clear `takes_at_once` if the subclass has another `send`."""
        super().__init_subclass__()
        if "send" in vars(cls) and "take" not in vars(cls):
            cls.takes_at_once = False

    def __init__(self, url: str) -> None:
        """Start unopened; `url` names the transport in errors and logs."""
        self._url = url
        self._stage: Stage = "new"
        self._receiver: Receiver | None = None  # None before opening and after the end
        self._error: ConnectionLost | None = None  # the first cause of a loss
        self._senders: deque[asyncio.Future[bool]] = deque()  # resolved with True if the system took the bytes
        self._watch = StallWatch(lambda: bool(self._senders), self._accepted, self._lose)

    @property
    def url(self) -> str:
        """Address of the transport, as written by the user."""
        return self._url

    @property
    def board_url(self) -> str:
        """Address of the board: different from `url` if a hub shares the board."""
        return self._url

    async def open(self, receiver: Receiver) -> None:
        """Open the device. Raise OpenError for a failure, and if the transport was opened or closed before."""
        if self._stage != "new":
            raise OpenError(f"{self.url}: a transport is opened once; make another")
        self._stage, self._receiver = "opening", receiver
        try:
            await self._open()
        except BaseException as error:
            self._end(None)
            if isinstance(error, Exception) and not isinstance(error, ServolinkError):
                raise OpenError(f"{self.url}: cannot open it: {self._explain(error)}") from error
            raise
        # Meanwhile `close` in another task, or the device in a callback, may have ended the connection.
        if self._was_ended():
            self._abort()
            if self._error is not None:
                raise OpenError(f"{self.url}: it was lost while being opened: {self._error}") from self._error
            raise OpenError(f"{self.url}: it was closed while being opened; try again")
        self._stage = "open"
        _logger.info("%s: opened", escape(self.url))

    async def send(self, data: bytes) -> None:
        """Send all of `data`. Raise ConnectionLost unless the connection is open and accepts all bytes."""
        if self._stage != "open":
            raise self._lost()
        try:
            if (accepted := self._send(data)) is not None:
                await accepted
        except ServolinkError:
            raise
        except Exception as error:
            self._lose(error)
            raise self._lost() from error

    def take(self, data: bytes) -> Awaitable[None] | None:
        """Queue all of `data` as `send` does. Return None if the system accepted all bytes, else an awaitable."""
        if self._stage != "open":
            raise self._lost()
        try:
            return self._send(data)
        except ServolinkError:
            raise
        except Exception as error:
            self._lose(error)
            raise self._lost() from error

    async def close(self) -> None:
        """Free the port within 1 s and call `lost(None)`, unless the connection was lost before."""
        if self._stage == "open":
            self._stage = "closing"
        elif self._stage in {"new", "opening"}:
            self._end(None)  # an `open` in progress checks the stage
        try:
            await self._close()
        finally:
            self._end(None)

    @abstractmethod
    async def _open(self) -> None:
        """Open the device. Raise OpenError with the remedy; after a failure or cancellation nothing stays open."""

    @abstractmethod
    def _send(self, data: bytes) -> Awaitable[None] | None:
        """Queue all of `data` immediately. Return None if the system accepted all bytes, else an awaitable.

        Empty `data` waits for all earlier bytes. Not a coroutine, so that a cancelled caller leaves nothing unsent; see
        `_until_accepted` for the usual awaitable.
        """

    @abstractmethod
    async def _close(self) -> None:
        """Give sent bytes a moment to leave, then free the port, within 1 s in total.

        Called for every `close`, in every stage, also before opening and again after the end.
        """

    @abstractmethod
    def _abort(self) -> None:
        """Release the device without waiting; called after the end of the connection, perhaps twice."""

    def _accepted(self) -> int:
        """Return a number growing with each byte accepted by the system; needed only by kinds with waiting senders."""
        return 0

    def _deliver(self, data: bytes) -> None:
        """Pass `data` to the receiver; an exception of the receiver ends the connection, as bytes are missing."""
        if self._receiver is not None:
            try:
                self._receiver.data(data)
            except Exception as error:  # noqa: BLE001 - any bug of the receiver
                self._lose(error)

    def _lose(self, cause: Exception) -> None:
        """End the connection because of `cause`; after the end, do nothing: the first cause stays."""
        self._end(cause)

    def _lost(self) -> ConnectionLost:
        """Return the reason why sending is impossible, as a new exception for each caller."""
        if self._error is None:
            state = "not open yet" if self._stage in {"new", "opening"} else "closed"
            return ConnectionLost(f"{self.url}: it is {state}")
        error = ConnectionLost(*self._error.args)
        error.__cause__ = self._error.__cause__ or self._error
        return error

    def _until_accepted(self, accepted: asyncio.Future[bool]) -> Awaitable[None]:
        """Return an awaitable that ends once `accepted` is resolved with True; raise ConnectionLost after the end.

        It counts as a sender at once: a pipe in memory accepts the bytes before a new task has begun to wait.
        """
        if self._stage == "ended":  # ended by `_send` itself: nobody would resolve the future
            raise self._lost()
        self._senders.append(accepted)
        self._watch.start()
        return self._until_resolved(accepted)

    async def _until_resolved(self, accepted: asyncio.Future[bool]) -> None:
        if not await accepted:
            raise self._lost()

    def _end(self, cause: Exception | None) -> None:
        if self._stage == "ended":
            return
        was_open = self._stage in {"open", "closing"}  # otherwise `open` raises, without a call of `lost`
        # First, as foreign code called below may call back: from here on nothing is sent or delivered, and nothing ends
        # a second time.
        self._stage = "ended"
        receiver, self._receiver = self._receiver, None
        if cause is not None:
            self._error = self._loss(cause)
        self._abort()  # before receivers learn of the end: a receiver may open the device again
        self._watch.stop()
        self._wake_senders(accepted=False)
        if receiver is not None and was_open:
            _logger.info("%s", self._error or f"{escape(self.url)}: closed")  # the error contains the address
            receiver.lost(self._error)

    def _loss(self, cause: Exception) -> ConnectionLost:
        if isinstance(cause, ConnectionLost):
            return cause
        error = ConnectionLost(f"{self.url}: the connection was lost: {self._explain(cause)}")
        error.__cause__ = cause
        return error

    def _explain(self, error: Exception) -> str:
        """Return the text of an error of another package."""
        return str(error) or type(error).__name__  # a TimeoutError often has no text

    def _was_ended(self) -> bool:
        return self._stage == "ended"

    def _wake_senders(self, *, accepted: bool) -> None:
        while self._senders:
            if not (sender := self._senders.popleft()).done():
                sender.set_result(accepted)


class WrappedTransport(BaseTransport):
    """Transport around another transport. Passes bytes in both directions, changed by subclasses."""

    def __init__(self, inner: Transport) -> None:
        """Wrap `inner`, from now on used by this transport only."""
        super().__init__(inner.url)
        self._inner = inner
        self.takes_at_once = self.takes_at_once and getattr(inner, "takes_at_once", False)
        take: Callable[[bytes], Awaitable[None] | None] | None = getattr(inner, "take", None)
        self._take = take if self.takes_at_once else None
        self.is_recorded = self.is_recorded or getattr(inner, "is_recorded", False)
        self._inner_is_open = False
        self._closing: asyncio.Task[None] | None = None  # kept here: the loop has weak references only

    def data(self, chunk: bytes, /) -> None:
        """Pass on a chunk of the wrapped transport."""
        self._deliver(chunk)

    def lost(self, error: Exception | None, /) -> None:
        """End the connection together with the wrapped transport."""
        self._inner_is_open = False
        self._end(error)

    async def _open(self) -> None:
        self._inner_is_open = True  # before opening: `lost` may be called before this task continues
        try:
            await self._inner.open(self)
        except BaseException:
            self._inner_is_open = False
            raise

    def _send(self, data: bytes) -> Awaitable[None] | None:
        return self._take(data) if data and self._take is not None else self._inner.send(data)

    async def _close(self) -> None:
        await self._close_inner()

    def _abort(self) -> None:
        """Close the wrapped transport after the end, unless already ended."""
        if self._inner_is_open:
            self._inner_is_open = False
            self._closing = asyncio.ensure_future(self._close_inner())
            self._closing.add_done_callback(self._closed)

    def _accepted(self) -> int:
        return self._inner._accepted() if isinstance(self._inner, BaseTransport) else 0  # noqa: SLF001 - of its own class

    async def _close_inner(self) -> None:
        await self._inner.close()

    def _closed(self, closing: asyncio.Task[None]) -> None:
        if not closing.cancelled() and (error := closing.exception()):  # no caller awaits the task
            _logger.warning("%s: closing it failed: %s", escape(self.url), escape(str(error)))

    def _break(self, reason: str) -> None:
        """Lose the connection immediately, then close the wrapped transport."""
        self._lose(ConnectionError(reason))


class StallWatch:
    """Watch for stalled sending, with a single timer for all waiting sends."""

    def __init__(
        self,
        waiting: Callable[[], bool],
        accepted: Callable[[], int],
        stalled: Callable[[TimeoutError], None],
        limit: Callable[[], float] = lambda: STALL_LIMIT,
    ) -> None:
        """Call `stalled` if `taken()` has not grown for `limit()` seconds while `waiting()` is true."""
        self._waiting = waiting
        self._accepted = accepted
        self._stalled = stalled
        self._limit = limit
        self._timer: asyncio.TimerHandle | None = None

    @property
    def running(self) -> bool:
        """Whether the timer is set."""
        return self._timer is not None

    def start(self) -> None:
        """Start the timer, unless set; the watch stops when no send waits."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, self._accepted(), 1)

    def stop(self) -> None:
        """Stop the watch immediately."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self, accepted: int, looks: int) -> None:
        """Compare progress with `accepted`; `looks` is the number of comparisons without progress."""
        self._timer = None
        if not self._waiting():
            return  # the next waiting send starts the watch again
        if self._accepted() != accepted:
            accepted, looks = self._accepted(), 0
        # Counted in comparisons, not in seconds: time also passes while the machine is suspended.
        elif looks * _STALL_STEP >= (limit := self._limit()):
            self._stalled(TimeoutError(f"it has taken no byte for {limit:g} s"))
            return
        self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, accepted, looks + 1)
