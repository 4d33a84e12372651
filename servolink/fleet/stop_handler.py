"""StopHandler: stops the board whenever anybody asks, however many do."""

from __future__ import annotations

import asyncio
from collections import deque

import msgspec

from servolink.fleet.answers import Answers, Sender
from servolink.fleet.hub_session import HubSession, result_of
from servolink.fleet.pulse import StopBarrier
from servolink.fleet.ready_run import ReadyRun
from servolink.fleet.topics import UNREADABLE, Stop, StopOver
from servolink.motion import StopCounter, Ticket

_MOST_ANSWERED = 256  # programs that ask during a stop


class StopHandler:
    """Handler of the stops of a board. Stops that come during another stop share the next."""

    def __init__(self, hub: HubSession, prepared: ReadyRun, barrier: StopBarrier, counter: StopCounter) -> None:
        """Stop the board of `hub`, forget the `prepared` run, and reject commands sent before."""
        self.counter = counter
        """Issuer of the tickets of commands."""
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

    async def until_stopped(self, ticket: Ticket) -> None:
        """Return when a stop has come since `ticket` was issued."""
        while self.counter.holds(ticket):
            await self._stopped.wait()

    async def close(self) -> None:
        """Answer the remaining waits for a stop."""
        if self._task is not None:
            await asyncio.wait((self._task,), timeout=1.0)
            self._task.cancel()

    def _count_stop(self) -> None:
        """Cancel all motions that were requested before now."""
        self._barrier.put_up()
        self.counter.stop()
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
    """Decode a message of the topic `stop`. An empty or unreadable message is a stop, too."""
    try:
        return msgspec.json.decode(payload, type=Stop)
    except UNREADABLE:
        return Stop()
