"""A test that goes through a table says which row failed."""

from __future__ import annotations

import asyncio
import inspect

import pytest

from tests.tables import over


def test_the_row_that_fails_is_named() -> None:
    @over("a", [1, 2])
    @over("b, c", [(1, 2), (2, 2)])
    def is_sum(start: int, a: int, b: int, c: int) -> None:
        assert start + a + b + c < 6

    assert [*inspect.signature(is_sum).parameters] == ["start"]
    with pytest.raises(AssertionError) as caught:
        is_sum(start=0)
    assert caught.value.__notes__ == ["in the row {'b': 2, 'c': 2}", "in the row {'a': 2}"]


def test_coroutines_run_and_an_empty_table_fails() -> None:
    seen: list[float] = []

    @over("seconds", [1.0, 2.0])
    async def waits(seconds: float) -> None:
        await asyncio.sleep(seconds)
        seen.append(asyncio.get_running_loop().time())

    waits()
    assert seen == [1001.0, 1002.0]
    with pytest.raises(AssertionError, match="no rows"):
        over("seconds", [])(waits)()
