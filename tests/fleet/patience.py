"""Patience that ends when a test says so, and not by the clock: a busy machine is no silent board."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from servolink.fleet.pending_command import PendingCommand

_AGAIN = 0.05  # seconds
LIMIT = 120.0
"""Seconds of patience that is not waited out, however busy the machine is."""


def patience_ends(monkeypatch: pytest.MonkeyPatch, is_over: Callable[[PendingCommand], bool]) -> None:
    """Have whoever waits for the results to a message find its deadline passed as soon as `is_over` of it."""
    wait = PendingCommand.wait

    async def until_over(pending: PendingCommand, deadline: float) -> bool:
        loop = asyncio.get_running_loop()
        while not is_over(pending) and loop.time() < deadline:  # what decides may change without a result
            if await wait(pending, min(deadline, loop.time() + _AGAIN)):
                return True
        return False

    monkeypatch.setattr(PendingCommand, "wait", until_over)


def have_answered(*boards: str) -> Callable[[PendingCommand], bool]:
    """Return whether these boards have answered: those that are silent are not going to."""
    return lambda pending: pending.results.keys() >= set(boards)
