"""StopHandler: stops the board whenever anybody asks, however many do."""

from __future__ import annotations

import asyncio
from collections import deque

import msgspec

from servolink.fleet.answers import Answers, Sender
from servolink.fleet.hub_session import HubSession, result_of
from servolink.fleet.prepared import PreparedRun
from servolink.fleet.pulse import StopBarrier
from servolink.fleet.topics import UNREADABLE, Stop, StopOver

_MOST_ANSWERED = 256  # of those who ask while a stop is under way


class StopHandler:
    """Takes stops of one board. Those that come while one is under way share the next."""

    def __init__(self, hub: HubSession, prepared: PreparedRun, barrier: StopBarrier) -> None:
        """Stop the board of `hub`, forget what is `prepared`, and keep out by `barrier` what was sent before."""
        self.count = 0
        """Stops so far: what was asked for before the latest must not begin any more."""
        self._hub = hub
        self._prepared = prepared
        self._barrier = barrier
        self._waiting: deque[tuple[str, Sender, Answers]] = deque(maxlen=_MOST_ANSWERED)
        self._task: asyncio.Task[None] | None = None
        self._stopped = asyncio.Event()

    def stop(self, command_id: str, sender: Sender, answers: Answers) -> None:
        """Stop the board, and answer when it has stopped."""
        self._count_stop()
        self._waiting.append((command_id, sender, answers))
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._stop_all())

    def stopped_here(self) -> None:
        """Count a stop by another program of the hub."""
        self._count_stop()
        self._barrier.send_word()

    async def until_after(self, count: int) -> None:
        """Return when there have been more stops than `count`."""
        while self.count == count:
            await self._stopped.wait()

    async def close(self) -> None:
        """Answer those who still wait."""
        if self._task is not None:
            await asyncio.wait((self._task,), timeout=1.0)
            self._task.cancel()

    def _count_stop(self) -> None:
        """Let nothing begin that was asked for before now."""
        self._barrier.put_up()
        self.count += 1
        self._stopped.set()
        self._stopped = asyncio.Event()
        self._prepared.forget()

    async def _stop_all(self) -> None:
        while self._waiting:
            asked, self._waiting = self._waiting, deque(maxlen=_MOST_ANSWERED)
            try:
                result_of(await self._hub.ask("stop", {}))
            except Exception as error:  # noqa: BLE001 - whatever prevents a stop is an answer
                self._barrier.send_word()
                for command_id, sender, answers in asked:
                    answers.fail(command_id, sender, error)
            else:
                self._barrier.send_word()
                for command_id, sender, answers in asked:
                    answers.succeed(command_id, sender, StopOver(self._barrier.word))


def read_stop(payload: bytes) -> Stop:
    """Return what a message of `stop` says. One that says nothing, or nonsense, is a stop, too."""
    try:
        return msgspec.json.decode(payload, type=Stop)
    except UNREADABLE:
        return Stop()
