"""RpcChannel: the control interface of a hub, as a program uses it (docs/reference/control-interface.md)."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Generic, TypeVar

import msgspec
from msgspec import UNSET, Raw, Struct, UnsetType

from servolink.control.error_codes import ErrorObject
from servolink.control.greeting import Greeting, Welcome
from servolink.control.notifications import ProgressNotice, StoppedNotice
from servolink.control.peer import decode, encode
from servolink.control.share_address import greet
from servolink.errors import (
    ConnectionLost,
    OpenError,
    RequestTimeout,
    ServolinkError,
    escape,
)

_MOST_BYTES = 64 * 1024 * 1024  # of one message: four times the largest project
_CLOSING_LIMIT = 1.0  # seconds
_logger = logging.getLogger(__name__)

K = TypeVar("K")
T = TypeVar("T")


class Reply(Struct):
    """Reply of a hub: the result of a method, or an error as in the reference; both as JSON."""

    result: Raw = Raw(b"")
    error: Raw | UnsetType = UNSET

    @property
    def fault(self) -> ErrorObject | None:
        """Error of the hub; None for a result."""
        return None if self.error is UNSET else decode(self.error, ErrorObject)


class _RpcMessage(Reply):
    """A response or a notification; a newer hub may say more."""

    id: int | None = None
    method: str | None = None
    params: Raw = Raw(b"{}")


class PendingCalls(Generic[K, T]):
    """Pending calls by id, until response, cancellation or the end of the connection."""

    def __init__(self) -> None:
        self._futures: dict[K, asyncio.Future[T]] = {}

    @contextmanager
    def expect(self, call_id: K) -> Iterator[asyncio.Future[T]]:
        """Yield the response to await; send the request in this context."""
        future: asyncio.Future[T] = asyncio.get_running_loop().create_future()
        self._futures[call_id] = future
        try:
            yield future
        finally:
            self._futures.pop(call_id, None)

    def settle(self, call_id: K, response: T) -> None:
        """Wake the caller of a response, unless the call has ended."""
        future = self._futures.get(call_id)
        if future is not None and not future.done():
            future.set_result(response)

    def fail_all(self, error: Callable[[], Exception]) -> None:
        """Raise a new error in each caller: the connection has ended."""
        for future in self._futures.values():
            if not future.done():
                future.set_exception(error())


class RpcChannel(asyncio.Protocol):
    """Calls methods of a hub and hears its notifications."""

    def __init__(self, name: str) -> None:
        self.ended: ConnectionLost | None = None
        """Reason for the end of the connection; None while it lives."""
        self.on_notification: Callable[[str, Raw], None] | None = None
        """Callback for each notification, with name and params; must not raise."""
        self.on_end: Callable[[], None] | None = None
        """Callback for the end of the hub; not called by `close`."""
        self._name = name
        self._pipe: asyncio.Transport | None = None
        self._heard = bytearray()
        self._searched = 0  # bytes searched without finding a line end
        self._number = 0
        self._calls = PendingCalls[int | None, Reply]()
        self._progress: dict[int | str | None, Callable[[Raw], None]] = {}
        self._lost = asyncio.get_running_loop().create_future()

    async def open(self, greeting: Greeting) -> Welcome:
        """Connect to the hub. Raise OpenError with the remedy."""
        self._pipe, welcome = await greet(self._name, greeting, self)
        self._pipe.resume_reading()
        if welcome.stops is not None and greeting.role != "watch":
            self.tell("stop.heard", number=welcome.stops)
        return welcome

    async def call(self, method: str, *, timeout: float | None = None, **params: Any) -> Raw:
        """Return the result of a method, as JSON. Raise the error of the library that the hub sends.

        Raise RequestTimeout after `timeout` seconds, and ConnectionLost if the hub is gone.
        """
        try:
            async with asyncio.timeout(timeout):
                reply = await self.ask(method, params)
        except TimeoutError as error:
            if isinstance(error, ServolinkError):
                raise
            raise RequestTimeout(f"the hub of {self._name} has not answered {method} within {timeout:g} s") from None
        if (fault := reply.fault) is not None:
            raise fault.as_error()
        return reply.result

    async def ask(self, method: str, params: object, on_progress: Callable[[Raw], None] | None = None) -> Reply:
        """Return the reply of the hub, which may be an error; pass notifications of progress to `on_progress`.

        Raise ConnectionLost if the hub is gone.
        """
        if self.ended is not None or self._pipe is None:
            raise self._ended_error()
        self._number += 1
        number = self._number
        if on_progress is not None:
            self._progress[number] = on_progress
        try:
            with self._calls.expect(number) as reply:
                self._send({"id": number, "method": method, "params": params})
                return await reply
        finally:
            self._progress.pop(number, None)

    def tell(self, method: str, **params: Any) -> None:
        """Call a method without waiting for it."""
        if self.ended is None:
            self._send({"method": method, "params": params})

    async def until_ended(self) -> None:
        """Wait until the hub is gone."""
        await asyncio.wait((self._lost,))

    async def close(self) -> None:
        """Disconnect from the hub; may be called again."""
        self.on_notification = self.on_end = None
        if self._pipe is None or self.ended is not None:
            return
        self._pipe.close()
        await asyncio.wait((self._lost,), timeout=_CLOSING_LIMIT)
        self._pipe.abort()

    def abort(self) -> None:
        """Disconnect at once, as if the hub were gone."""
        if self._pipe is not None:
            self._pipe.abort()

    def _send(self, message: dict[str, Any]) -> None:
        if self._pipe is not None:
            self._pipe.write(encode({"jsonrpc": "2.0", **message}) + b"\n")

    def _ended_error(self) -> ConnectionLost:
        return ConnectionLost(f"the hub of {self._name} is gone: start it again with `servolink share`")

    # --- called by asyncio --------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        """Take each message that is complete."""
        self._heard += data
        while (end := self._heard.find(b"\n", self._searched)) >= 0:
            line = bytes(self._heard[:end])
            del self._heard[: end + 1]
            self._searched = 0
            self._take(line)
        self._searched = len(self._heard)
        if len(self._heard) > _MOST_BYTES:
            self.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Fail all calls: the hub is gone."""
        self.ended = self._ended_error()
        self._calls.fail_all(self._ended_error)
        if not self._lost.done():
            self._lost.set_result(None)
        if self.on_end is not None:
            self.on_end()

    def _take(self, line: bytes) -> None:
        try:
            message = decode(line, _RpcMessage)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            _logger.warning("%s: a message of the hub cannot be read: %s", escape(self._name), escape(str(error)))
            return
        if message.method is not None:
            self._hear(message.method, message.params)
        else:
            self._calls.settle(message.id, message)

    def _hear(self, method: str, params: Raw) -> None:
        if method == "progress" and self._progress:
            with suppress(msgspec.MsgspecError):  # progress of another program's request
                if on_progress := self._progress.get(msgspec.json.decode(params, type=ProgressNotice).id):
                    on_progress(params)
        if self.on_notification is not None:
            self.on_notification(method, params)
        if method == "stopped":
            with suppress(msgspec.MsgspecError):
                if (number := msgspec.json.decode(params, type=StoppedNotice).number) is not None:
                    self.tell("stop.heard", number=number)


async def open_channel(name: str, greeting: Greeting) -> tuple[RpcChannel, Welcome]:
    """Connect to the control interface of the hub `name`. Raise OpenError, which says what to do."""
    if greeting.wants != "rpc":
        raise OpenError("the control interface is JSON-RPC: the greeting must want it")
    channel = RpcChannel(name)
    return channel, await channel.open(greeting)
