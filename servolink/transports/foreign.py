"""Transports of other packages: all errors become errors of servolink, and time limits prevent a hang."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable
from contextlib import suppress

from servolink.errors import ConnectionLost, OpenError, Reason, ServolinkError, TransportError, escape
from servolink.transports.base import STALL_LIMIT, Transport
from servolink.transports.lifecycle import BaseTransport, StallWatch, WrappedTransport

_OPEN_LIMIT = 60.0  # seconds for opening
_CLOSE_LIMIT = 1.0  # seconds for closing
_SLOWEST = 960.0  # bytes per second at 9600 baud: a long send may take this time in addition to STALL_LIMIT
_logger = logging.getLogger("servolink.transport")


def contained(transport: Transport) -> Transport:
    """Return `transport` inside a ForeignTransport; transports of servolink are returned unchanged."""
    is_own = type(transport).__module__.split(".")[0] == "servolink"
    if isinstance(transport, BaseTransport) and (is_own or transport.is_shared):  # hubs are recognised by type
        return transport
    return ForeignTransport(transport, f"the transport {type(transport).__name__}")


class ForeignTransport(WrappedTransport):
    """Transport of another package, with its maker named in errors, and a time limit for each call."""

    def __init__(self, inner: Transport, maker: str) -> None:
        """Wrap `inner`, called `maker` in errors, such as `the plug-in acme-boards`."""
        super().__init__(inner)
        self._maker = maker
        self._gave_up = False  # closing failed, and is not tried again
        self._untaken = 0  # bytes in unfinished sends
        self._returned = 0  # number of finished sends
        self._waits: set[asyncio.Timeout] = set()  # time limits of unfinished sends, cancelled with the connection
        self._watch = StallWatch(lambda: bool(self._waits), self._accepted, self._stalled, self._send_limit)

    async def _open(self) -> None:
        limit = asyncio.timeout(_OPEN_LIMIT)
        try:
            async with limit:
                await super()._open()
        except TransportError:
            raise
        except Exception as error:
            with suppress(Exception):  # the failed call may have left something open
                async with asyncio.timeout(_CLOSE_LIMIT):
                    await self._inner.close()
            self._gave_up = True
            if limit.expired():
                raise OpenError(
                    f"{self.url}: {self._maker} did not open it within {_OPEN_LIMIT:g} s; check whether the board is "
                    "there and switched on",
                    reason=Reason.NO_RESPONSE,
                ) from error
            raise

    def _send(self, data: bytes) -> Awaitable[None] | None:
        taking = super()._send(data)
        return None if taking is None else self._until_returned(taking, len(data))

    async def _until_returned(self, taking: Awaitable[None], size: int) -> None:
        """Await `taking` until the send returns or fails, or the connection ends."""
        self._untaken += size
        try:
            async with asyncio.timeout(None) as wait:
                self._waits.add(wait)
                self._watch.start()
                try:
                    await taking
                finally:
                    self._waits.discard(wait)
        except ServolinkError:
            raise
        except Exception as error:
            self._lose(error)
            raise self._lost() from error
        finally:
            self._untaken -= size
            self._returned += 1

    def _accepted(self) -> int:
        return self._returned + super()._accepted()

    def _send_limit(self) -> float:
        return STALL_LIMIT + self._untaken / _SLOWEST

    def _stalled(self, _: TimeoutError) -> None:
        text = f"{self._maker} did not return from send within {self._send_limit():g} s"
        self._lose(ConnectionLost(f"{self.url}: the connection was lost: {text}"))

    def _abort(self) -> None:
        waits, self._waits = self._waits, set()
        for wait in waits:
            wait.reschedule(0)
        super()._abort()

    async def _close_inner(self) -> None:
        if self._gave_up:
            return
        limit = asyncio.timeout(_CLOSE_LIMIT)
        try:
            async with limit:
                await super()._close_inner()
        except Exception as error:  # noqa: BLE001 - closing goes on, whatever it raises
            self._inner_is_open, self._gave_up = False, True
            late = f"{self._maker} did not close it within {_CLOSE_LIMIT:g} s"
            text = late if limit.expired() else self._explain(error)
            _logger.warning("%s: closing it failed: %s", escape(self.url), escape(text))

    def _explain(self, error: Exception) -> str:
        return f"{type(error).__name__}: {error} (raised by {self._maker})"
