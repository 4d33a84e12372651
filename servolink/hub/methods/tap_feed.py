"""TapFeed: what passes through the hub, for one program. One that does not read loses some of it, and is told."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from servolink.control.notifications import TapFrame, TapItem
from servolink.files import MIB
from servolink.hub.engine.tap import HubTap
from servolink.hub.hub import Hub
from servolink.hub.methods.feeds import Notify
from servolink.recorder.backlog import Backlog
from servolink.recorder.channels import TOPICS

_EVERY = 0.05  # seconds: a notification for each message would cost the hub more than the message
_MOST_AT_ONCE = 64 * 1024  # bytes of messages in a notification
_TELEMETRY_BYTES, _MOST_BYTES = MIB, 8 * MIB
_WHY = "the program that records reads too slowly"


class TapFeed:
    """Sends notifications `tap`, as many as the program reads."""

    def __init__(self, hub: Hub, notify: Notify, is_paused: Callable[[], bool]) -> None:
        """Send nothing while `is_paused()`, but keep some MiB."""
        self._hub = hub
        self._notify = notify
        self._is_paused = is_paused
        self._loop = asyncio.get_running_loop()
        self._tap: HubTap | None = None
        self._backlog = Backlog(_TELEMETRY_BYTES, _MOST_BYTES, why=_WHY)
        self._timer: asyncio.TimerHandle | None = None

    def now(self) -> float:
        """Return the present time, as the messages have it."""
        return self._loop.time()

    def start(self, *, wire_only: bool) -> None:
        """Send from now on."""
        self.stop()
        self._tap = HubTap(self._hub, self._backlog.put, wire_only=wire_only)
        self._timer = self._loop.call_later(_EVERY, self._flush)

    def stop(self) -> None:
        """Send what is left, and then nothing more."""
        if self._tap is not None:
            self._tap.close()
            self._tap = None
            self._backlog.tell_dropped(self.now())
            self._send_waiting()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _flush(self) -> None:
        self._timer = self._loop.call_later(_EVERY, self._flush)
        self._send_waiting()

    def _send_waiting(self) -> None:
        backlog = self._backlog
        while backlog.size and not self._is_paused():
            items = list[TapItem]()
            end = max(0, backlog.size - _MOST_AT_ONCE)
            while backlog.size > end and (timed := backlog.take()) is not None:
                items.append(TapItem(timed.seconds, TOPICS[type(timed.message)], timed.message))
            self._notify(TapFrame(tuple(items)))
