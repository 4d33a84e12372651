"""Pauses between attempts, and connections that are opened again."""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import OpenError, TransportUnavailable
from servolink.support.pauses import Pauses, Reconnecting
from tests.virtual_time import run


def test_each_pause_is_twice_as_long_up_to_the_longest() -> None:
    async def main() -> list[float]:
        loop, pauses = asyncio.get_running_loop(), Pauses(0.1, 0.5, jitter=lambda: 2.0)
        lengths = []
        for number in range(6):
            if number == 5:
                pauses.restart()
            began = loop.time()
            await pauses.wait()
            lengths.append(loop.time() - began)
        return lengths

    assert run(main()) == pytest.approx([0.2, 0.4, 0.8, 1.0, 1.0, 0.2])


def test_a_connection_is_opened_at_once_and_again_after_each_failure_and_each_round() -> None:
    async def main() -> list[tuple[str, float]]:
        loop, outcomes = asyncio.get_running_loop(), iter(["", "first", "", "", "second", "third"])

        async def open_() -> str:
            if not (name := next(outcomes)):
                raise OpenError("not plugged in")
            return name

        pauses, began = Pauses(1.0, 8.0), loop.time()
        found = []
        async for name in Reconnecting(open_, pauses, lambda error: isinstance(error, OpenError)):
            found.append((name, loop.time() - began))
            if name == "second":
                pauses.restart()
            if name == "third":
                break
        return found

    assert run(main()) == [("first", 1.0), ("second", 1.0 + 2.0 + 4.0 + 8.0), ("third", 16.0)]


async def test_an_error_that_must_not_be_retried_is_raised() -> None:
    async def open_() -> str:
        raise TransportUnavailable("unknown scheme")

    with pytest.raises(TransportUnavailable, match="unknown scheme"):
        await anext(Reconnecting(open_, Pauses(), lambda error: not isinstance(error, TransportUnavailable)))
