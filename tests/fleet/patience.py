"""Patience that ends when a test says so, and not by the clock: a busy machine is no silent board."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from servolink.fleet.exchange import Exchange

_AGAIN = 0.05  # seconds
LIMIT = 120.0
"""Seconds of patience that is not waited out, however busy the machine is."""


def patience_ends(monkeypatch: pytest.MonkeyPatch, is_over: Callable[[Exchange], bool]) -> None:
    """Have whoever waits for the results of an exchange find its deadline passed as soon as `is_over` of it."""
    wait = Exchange.wait

    async def until_over(exchange: Exchange, deadline: float) -> bool:
        loop = asyncio.get_running_loop()
        while not is_over(exchange) and loop.time() < deadline:  # what decides may change without a result
            if await wait(exchange, min(deadline, loop.time() + _AGAIN)):
                return True
        return False

    monkeypatch.setattr(Exchange, "wait", until_over)


def have_answered(*boards: str) -> Callable[[Exchange], bool]:
    """Return whether these boards have answered: those that are silent are not going to."""
    return lambda exchange: exchange.results.keys() >= set(boards)
