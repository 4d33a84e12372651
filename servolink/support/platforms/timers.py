"""Timers of event loops."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from typing import Any


def call_at(
    loop: asyncio.AbstractEventLoop, when: float, callback: Callable[..., object], *args: Any
) -> asyncio.TimerHandle:
    """Call `callback(*args)` when the time of `loop` is `when`; as soon as possible if that time has passed.

    The event loop of Pyodide raises ValueError for a time that has passed, even if only while the call was made.
    """
    if sys.platform == "emscripten":
        return loop.call_later(max(0.0, when - loop.time()), callback, *args)
    else:
        return loop.call_at(when, callback, *args)
