"""Pulse: how old a message can be, without any clock but this machine's own.

The bridge sends itself a new word each second, through the broker. What comes after such a word was sent by the broker
after the bridge had sent the word. A sender that puts the latest word into a command shows that the command was made
after it. So a command that a stalled network brings late is known to be late, even if all clocks are wrong.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import NoReturn

from servolink.errors import ServolinkError

INTERVAL = 1.0
SLACK = 1.5
"""Seconds by which a command may seem late: the word is up to a second old, and brokers count in whole seconds."""

_MOST_KEPT = 120  # twice the longest expiry


class Pulse:
    """The words of one board, and when they were sent."""

    def __init__(self, send: Callable[[str], Awaitable[None]]) -> None:
        """Send words with `send`."""
        self._send = send
        self._name = secrets.token_hex(4)
        self._number = 0
        self._times: dict[str, float] = {}
        self._newest = float("-inf")

    def begin(self) -> None:
        """Start over: all that comes on a new connection is sent from now on."""
        self._newest = asyncio.get_running_loop().time()

    async def run(self) -> NoReturn:
        """Send a word each second."""
        while True:
            with suppress(ServolinkError):
                await self.beat()
            await asyncio.sleep(INTERVAL)

    async def beat(self) -> None:
        """Send the next word."""
        self._number += 1
        word = f"{self._name}-{self._number}"
        self._times[word] = asyncio.get_running_loop().time()
        if len(self._times) > _MOST_KEPT:
            del self._times[next(iter(self._times))]
        await self._send(word)

    def heard(self, word: str) -> None:
        """Take a word that the broker has sent back."""
        self._newest = max(self._newest, self._times.get(word, float("-inf")))

    def latest(self, expiry: float, word: str | None) -> float:
        """Return the time until which a message that comes now may be acted upon.

        `expiry` is what was left of it when the broker sent it; `word` is the one in it.
        """
        begun = self._newest if word is None else min(self._newest, self._times.get(word, float("-inf")))
        return begun + expiry + SLACK
