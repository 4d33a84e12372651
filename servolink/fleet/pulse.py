"""Pulse: age limit of messages, measured only with this machine's clock.

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

from servolink.errors import ConnectionLost, ServolinkError
from servolink.support import time_with_sleep

INTERVAL = 1.0
SLACK = 1.5
"""Seconds by which a command may seem late: the word is up to a second old, and brokers count in whole seconds."""

_MOST_KEPT = 120  # twice the longest expiry


class Pulse:
    """Words of a board, with the time of sending."""

    def __init__(self, send: Callable[[str, int], Awaitable[None]]) -> None:
        """Send words with `send`, which takes a word and the QoS."""
        self._send = send
        self._name = secrets.token_hex(4)
        self._number = 0
        self._times: dict[str, float] = {}
        self._of_another: bytes | None = None

    async def run(self) -> NoReturn:
        """Send a word each second."""
        while True:
            with suppress(ServolinkError):
                await self._send(self.new_word(), 0)
            await asyncio.sleep(INTERVAL)

    def new_word(self) -> str:
        """Return the next word, to be sent immediately."""
        self._number += 1
        word = f"{self._name}-{self._number}"
        self._times[word] = time_with_sleep()
        if len(self._times) > _MOST_KEPT:
            del self._times[next(iter(self._times))]
        return word

    async def send(self, word: str) -> None:
        """Send a word in the order of the commands, which have QoS 1, too."""
        await self._send(word, 1)

    def shows_another(self, payload: bytes) -> bool:
        """Return whether a returned word shows another program with words for the board.

        The first one that is not of this pulse may have been left by an earlier program.
        """
        if not payload or payload.startswith(f"{self._name}-".encode()):
            return False
        before, self._of_another = self._of_another, payload
        return before not in {None, payload}

    def time_of(self, word: str) -> float:
        """Return the time at which a word was sent; minus infinity for an unknown or old word."""
        return self._times.get(word, float("-inf"))


class PulseLink:
    """Connection on which the words of a pulse come back."""

    def __init__(self, pulse: Pulse) -> None:
        self._pulse = pulse
        self._newest = float("-inf")

    def begin(self) -> None:
        """Start over: all messages of a new connection are sent from now on."""
        self._newest = time_with_sleep()

    def heard(self, payload: bytes) -> None:
        """Take a word that the broker has sent back."""
        self._newest = max(self._newest, self._pulse.time_of(payload.decode("ascii", "replace")))

    def latest(self, expiry: float, word: str | None) -> float:
        """Return the time until which a message received now may be acted upon.

        `expiry` is how much was left of it when the broker sent it; `word` is the one in it.
        """
        begun = self._newest if word is None else min(self._newest, self._pulse.time_of(word))
        return begun + expiry + SLACK


class StopBarrier:
    """Barrier against commands that were sent before a stop and arrive after the stop.

    A stop has a connection of its own, and overtakes: a word is sent on the connection of the commands, and what comes
    before the word comes back was sent before the stop. What is still on its way to the broker then, in a network that
    stands still, shows its age by the word in it, which is older.
    """

    def __init__(self, pulse: Pulse) -> None:
        self.word = ""
        """Word of the latest stop: commands with this word or a later word were made after the stop."""
        self.is_up = False
        """Whether messages received now, which show no word, may have been sent before the stop."""
        self._pulse = pulse
        self._put_up_at = float("-inf")
        self._task: asyncio.Task[None] | None = None

    def put_up(self) -> None:
        """Reject commands sent before now, and all without a word until that of `send_word` has come back."""
        self.word, self.is_up = self._pulse.new_word(), True
        self._put_up_at = self._pulse.time_of(self.word)

    def rejects(self, word: str | None) -> bool:
        """Return whether a command received now, with `word` in its content, may have been sent before the stop.

        Two connections have no common order: a command with the word of the result may come before the word is back.
        """
        return self.is_up if word is None else self._pulse.time_of(word) < self._put_up_at

    def send_word(self) -> None:
        """Send the word while the barrier is up: after the stop, which is more urgent, and on a new connection."""
        if self.is_up:
            self._task = asyncio.get_running_loop().create_task(self._send(self.word))

    def heard(self, payload: bytes) -> None:
        """Take a word sent back by the broker."""
        if payload == self.word.encode():
            self.is_up = False

    async def _send(self, word: str) -> None:
        try:
            await self._pulse.send(word)
        except ConnectionLost:  # sent again on the next connection
            pass
        except ServolinkError:  # the broker denies the topic, and has said so
            self.is_up = False
