"""The life of a transport, the same for every kind: opened once, lost once, closed as often as anyone likes."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Literal, TypeAlias

from servolink.errors import ConnectionLost, OpenError, ServolinkError
from servolink.escaping import escape
from servolink.transports.base import STALL_LIMIT, Receiver, Transport

_logger = logging.getLogger("servolink.transport")

_STALL_STEP = STALL_LIMIT / 8

Stage: TypeAlias = Literal["new", "opening", "open", "closing", "ended"]


class BaseTransport(ABC):
    """Everything a transport promises except the bytes themselves: a kind adds `_open`, `_send`, `_close`, `_abort`.

    A kind calls `_deliver` with each chunk that arrives and `_lose` with any error that ends the connection. Any
    exception that is not a ServolinkError becomes an OpenError or a ConnectionLost, so that a kind need not translate
    the errors of its library.
    """

    takes_at_once = True
    """Whether `take` has all of the data when it returns, awaited or not."""
    is_recorded = False
    """Whether what is sent is recorded or compared with a recording, so that it must not depend on chance."""
    is_shared = False
    """Whether a hub is at the other end, which repeats requests itself and keeps programs apart."""

    def __init_subclass__(cls) -> None:
        """Take nothing at once past a `send` of the subclass."""
        super().__init_subclass__()
        if "send" in vars(cls) and "take" not in vars(cls):
            cls.takes_at_once = False

    def __init__(self, url: str) -> None:
        """Start unopened; errors and log lines call the transport `url`."""
        self._url = url
        self._stage: Stage = "new"
        self._receiver: Receiver | None = None  # None again after the end
        self._error: ConnectionLost | None = None  # the first cause of a loss
        self._senders: deque[asyncio.Future[bool]] = deque()  # resolved with whether the system took their bytes
        self._watch = StallWatch(lambda: bool(self._senders), self._taken, self._lose)

    @property
    def url(self) -> str:
        """The address it leads to."""
        return self._url

    @property
    def board_url(self) -> str:
        """The address of the board itself: another one if a hub is in between."""
        return self._url

    async def open(self, receiver: Receiver) -> None:
        """Open the device; raise OpenError if that fails or if this transport was opened or closed before."""
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
        # `close` and the device itself may have ended it meanwhile, in another task or in a callback.
        if self._was_ended():
            self._abort()
            if self._error is not None:
                raise OpenError(f"{self.url}: it was lost while being opened: {self._error}") from self._error
            raise OpenError(f"{self.url}: it was closed while being opened; try again")
        self._stage = "open"
        _logger.info("%s: opened", escape(self.url))

    async def send(self, data: bytes) -> None:
        """Send all of `data`; raise ConnectionLost unless the connection is open and takes it."""
        if self._stage != "open":
            raise self._lost()
        try:
            if (taken := self._send(data)) is not None:
                await taken
        except ServolinkError:
            raise
        except Exception as error:
            self._lose(error)
            raise self._lost() from error

    def take(self, data: bytes) -> Awaitable[None] | None:
        """Take all of `data` as `send` does; return None if the system has it, or what to await until it has."""
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
            self._end(None)  # `open` notices
        try:
            await self._close()
        finally:
            self._end(None)

    @abstractmethod
    async def _open(self) -> None:
        """Open the device; OpenError says what to do, and nothing is left open, also after a cancellation."""

    @abstractmethod
    def _send(self, data: bytes) -> Awaitable[None] | None:
        """Take all of `data` at once; return None if the system has it, or what to await until it has.

        Empty `data` asks for whatever was sent before. Not a coroutine, so that nothing is left unsent when the
        caller is cancelled; see `_until_taken` for the usual thing to await.
        """

    @abstractmethod
    async def _close(self) -> None:
        """Give sent bytes a moment to leave, then free the port, within 1 s in all.

        Called for every `close`, in every stage: before opening and again after the end too.
        """

    @abstractmethod
    def _abort(self) -> None:
        """Release the device without waiting; called once the connection has ended, perhaps twice."""

    def _taken(self) -> int:
        """Return a number that grows with every byte the system takes; needed only if senders ever wait."""
        return 0

    def _deliver(self, data: bytes) -> None:
        """Pass `data` to the receiver; one that fails ends the connection instead of missing bytes unnoticed."""
        if self._receiver is not None:
            try:
                self._receiver.data(data)
            except Exception as error:  # noqa: BLE001 - any bug of the receiver
                self._lose(error)

    def _lose(self, cause: Exception) -> None:
        """End the connection because of `cause`; ignored if it has ended already, so the first cause stays."""
        self._end(cause)

    def _lost(self) -> ConnectionLost:
        """Return the reason why nothing can be sent, as an exception of its own for each caller."""
        if self._error is None:
            state = "not open yet" if self._stage in {"new", "opening"} else "closed"
            return ConnectionLost(f"{self.url}: it is {state}")
        error = ConnectionLost(*self._error.args)
        error.__cause__ = self._error.__cause__ or self._error
        return error

    async def _until_taken(self, taken: asyncio.Future[bool]) -> None:
        """Wait until the kind resolves `taken` with True, or the connection ends."""
        if self._stage == "ended":  # by `_send` itself: nothing would resolve the future
            raise self._lost()
        self._senders.append(taken)
        self._watch.start()
        if not await taken:
            raise self._lost()

    def _end(self, cause: Exception | None) -> None:
        if self._stage == "ended":
            return
        was_open = self._stage in {"open", "closing"}  # otherwise `open` raises, and `lost` is not called
        # First of all, as the rest calls foreign code, which may call us: from here on nothing is sent or delivered,
        # and nothing ends a second time.
        self._stage = "ended"
        receiver, self._receiver = self._receiver, None
        if cause is not None:
            self._error = self._loss(cause)
        self._abort()  # before others learn of the end: they may want to open the device again
        self._watch.stop()
        self._wake_senders(taken=False)
        if receiver is not None and was_open:
            _logger.info("%s", self._error or f"{escape(self.url)}: closed")  # the error names the address itself
            receiver.lost(self._error)

    def _loss(self, cause: Exception) -> ConnectionLost:
        if isinstance(cause, ConnectionLost):
            return cause
        error = ConnectionLost(f"{self.url}: the connection was lost: {self._explain(cause)}")
        error.__cause__ = cause
        return error

    def _explain(self, error: Exception) -> str:
        """Return the text of an error that is not ours."""
        return str(error) or type(error).__name__  # a TimeoutError often has no text

    def _was_ended(self) -> bool:
        return self._stage == "ended"

    def _wake_senders(self, *, taken: bool) -> None:
        while self._senders:
            if not (sender := self._senders.popleft()).done():
                sender.set_result(taken)


class WrappedTransport(BaseTransport):
    """A transport around another one: passes everything through both ways; a subclass changes what passes."""

    def __init__(self, inner: Transport) -> None:
        """Wrap `inner`, which must not be used otherwise."""
        super().__init__(inner.url)
        self._inner = inner
        self.takes_at_once = self.takes_at_once and getattr(inner, "takes_at_once", False)
        take: Callable[[bytes], Awaitable[None] | None] | None = getattr(inner, "take", None)
        self._take = take if self.takes_at_once else None
        self.is_recorded = self.is_recorded or getattr(inner, "is_recorded", False)
        self._inner_is_open = False
        self._closing: asyncio.Task[None] | None = None  # kept, as the loop does not keep its tasks

    def data(self, chunk: bytes, /) -> None:
        """Pass on a chunk of the wrapped transport."""
        self._deliver(chunk)

    def lost(self, error: Exception | None, /) -> None:
        """End with the wrapped transport."""
        self._inner_is_open = False
        self._end(error)

    async def _open(self) -> None:
        self._inner_is_open = True  # before opening, as `lost` may be called before this task runs on
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
        """Close the wrapped transport behind the end, unless it ended first."""
        if self._inner_is_open:
            self._inner_is_open = False
            self._closing = asyncio.ensure_future(self._close_inner())
            self._closing.add_done_callback(self._closed)

    def _taken(self) -> int:
        return self._inner._taken() if isinstance(self._inner, BaseTransport) else 0  # noqa: SLF001 - of its own class

    async def _close_inner(self) -> None:
        await self._inner.close()

    def _closed(self, closing: asyncio.Task[None]) -> None:
        if not closing.cancelled() and (error := closing.exception()):  # no caller waits for it
            _logger.warning("%s: closing it failed: %s", escape(self.url), escape(str(error)))

    def _break(self, reason: str) -> None:
        """Lose the connection now, and close the wrapped transport behind it."""
        self._lose(ConnectionError(reason))


class StallWatch:
    """Notices that the system takes no more bytes, with one timer however many sends wait."""

    def __init__(
        self,
        waiting: Callable[[], bool],
        taken: Callable[[], int],
        stalled: Callable[[TimeoutError], None],
        limit: Callable[[], float] = lambda: STALL_LIMIT,
    ) -> None:
        """While `waiting()`, call `stalled` once `taken()` has not grown for `limit()` seconds."""
        self._waiting = waiting
        self._taken = taken
        self._stalled = stalled
        self._limit = limit
        self._timer: asyncio.TimerHandle | None = None

    @property
    def running(self) -> bool:
        """Whether its timer is set."""
        return self._timer is not None

    def start(self) -> None:
        """Start, unless it is running; it stops by itself when no send waits any more."""
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, self._taken(), 1)

    def stop(self) -> None:
        """Stop at once."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _look(self, taken: int, looks: int) -> None:
        """Compare with `taken`, for the `looks`-th time in a row without progress."""
        self._timer = None
        if not self._waiting():
            return  # the next send that has to wait starts it again
        if self._taken() != taken:
            taken, looks = self._taken(), 0
        # Counted in looks, not in seconds: time also passes while the whole machine is suspended.
        elif looks * _STALL_STEP >= (limit := self._limit()):
            self._stalled(TimeoutError(f"it has taken no byte for {limit:g} s"))
            return
        self._timer = asyncio.get_running_loop().call_later(_STALL_STEP, self._look, taken, looks + 1)
