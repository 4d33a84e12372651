"""Boards for the tests of `servolink.sync`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

import servolink.sync
from servolink.sync.loop_thread import running_thread
from tests.client.piped_board import PipedBoard

P = ParamSpec("P")
T = TypeVar("T")


@contextmanager
def opened(fake: PipedBoard) -> Iterator[servolink.sync.Board]:
    """Connect to `fake`, without leaving traces of that."""
    fake.greeting = True
    with servolink.sync.connect(fake) as board:
        fake.greeting = False
        yield board


def on_loop(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function in the thread of the loop, where the fake board lives."""

    async def call() -> T:
        return function(*args, **kwargs)

    return running_thread().run(call)
