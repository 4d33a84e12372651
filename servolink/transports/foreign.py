"""Transports that are not ours: whatever they raise becomes an error of servolink, and they cannot hang a program."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable
from contextlib import suppress

from servolink.errors import ConnectionLost, OpenError, ServolinkError, TransportError
from servolink.escaping import escape
from servolink.transports.base import STALL_LIMIT, Transport
from servolink.transports.lifecycle import BaseTransport, StallWatch, WrappedTransport

_OPEN_LIMIT = 60.0  # seconds that it may take to open
_CLOSE_LIMIT = 1.0  # and to close
_SLOWEST = 960.0  # bytes per second, 9600 baud: what a send may take for much data, beside STALL_LIMIT
_logger = logging.getLogger("servolink.transport")


def contained(transport: Transport) -> Transport:
    """Return what keeps `transport` within limits; ours do that themselves, and are returned as they are."""
    is_ours = type(transport).__module__.split(".")[0] == "servolink"
    if isinstance(transport, BaseTransport) and (is_ours or transport.is_shared):  # a hub is known by the type
        return transport
    return ForeignTransport(transport, f"the transport {type(transport).__name__}")


class ForeignTransport(WrappedTransport):
    """A transport of another package, with errors that name its maker, and limits to all that it is asked to do."""

    def __init__(self, inner: Transport, maker: str) -> None:
        """Wrap `inner`; errors call it `maker`, such as `the plug-in acme-boards`."""
        super().__init__(inner)
        self._maker = maker
        self._gave_up = False  # closing it, which failed: it would do no better again
        self._untaken = 0  # bytes in sends that have not returned
        self._returned = 0  # sends
        self._waits: set[asyncio.Timeout] = set()  # of these sends, which end with the connection
        self._watch = StallWatch(lambda: bool(self._waits), self._taken, self._stalled, self._send_limit)

    async def _open(self) -> None:
        limit = asyncio.timeout(_OPEN_LIMIT)
        try:
            async with limit:
                await super()._open()
        except TransportError:
            raise
        except Exception as error:
            with suppress(Exception):  # it may have opened something before it failed
                async with asyncio.timeout(_CLOSE_LIMIT):
                    await self._inner.close()
            self._gave_up = True
            if limit.expired():
                raise OpenError(
                    f"{self.url}: {self._maker} did not open it within {_OPEN_LIMIT:g} s; check whether the board is "
                    "there and switched on"
                ) from error
            raise

    def _send(self, data: bytes) -> Awaitable[None] | None:
        taking = super()._send(data)
        return None if taking is None else self._until_returned(taking, len(data))

    async def _until_returned(self, taking: Awaitable[None], size: int) -> None:
        """Await `taking` until it returns, fails or the connection ends."""
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

    def _taken(self) -> int:
        return self._returned + super()._taken()

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
