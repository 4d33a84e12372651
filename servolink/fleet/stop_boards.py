"""Stop of all boards of a fleet: a message to all, repeated for each board without an answer."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress

import msgspec
from msgspec import Struct

from servolink.errors import ConnectionLost, InvalidAddress
from servolink.fleet.controller import Controller, new_id
from servolink.fleet.pending_command import PendingCommand, failure_of
from servolink.fleet.topics import Stop

PATIENCE = 5.0
"""Seconds until a board without an answer counts as silent."""
_AGAIN = 1.0  # seconds until the stop is repeated for a board without an answer
_MANY = 0.25  # share of the boards for which a message to all is quicker than messages to each


class Stopped(Struct, frozen=True):
    """Answers of the boards to a stop."""

    stopped: dict[str, float]
    """Seconds from the stop to the answer, for each board with servos reported as stopped."""
    failed: dict[str, str]
    """Errors of boards that could not confirm the stop."""
    silent: tuple[str, ...]
    """Boards that were connected with the broker and did not answer."""
    offline: tuple[str, ...]
    """Boards without a connection to the broker, which no message can reach."""

    @property
    def is_complete(self) -> bool:
        """Whether every board that is connected has stopped."""
        return not (self.failed or self.silent)


async def stop_all(
    controller: Controller, boards: Collection[str] | None = None, *, patience: float = PATIENCE
) -> Stopped:
    """Stop all boards at once, or only `boards`. A board without an answer after `patience` seconds is silent.

    Raise ConnectionLost if the broker is gone for as long, and no board is known that could be named.
    """
    loop = asyncio.get_running_loop()
    begun, stop = loop.time(), Stop(new_id(), controller.who)
    chosen = None if boards is None else tuple(dict.fromkeys(boards))
    with controller.pending_command(stop.id) as pending:
        pending.expect(_online(controller, chosen))  # a board lost during the stop may still move
        sending = asyncio.create_task(_send(controller, pending, stop, chosen, begun + patience))
        try:
            try:
                await controller.settle(patience)  # meanwhile the stop is under way
            except ConnectionLost:  # not for a moment only: there may be boards unknown here
                if not pending.awaited:
                    raise
            while True:
                pending.expect(_online(controller, chosen))  # boards join during the stop, too
                if not pending.awaited or await pending.until((), begun + patience):
                    break
        finally:
            sending.cancel()
            await asyncio.wait((sending,))
        failures = {board: failure_of(result) for board, result in pending.results.items()}
        known = [board.name for board in controller.roster] if chosen is None else chosen
        accounted = {*controller.roster.online, *failures, *pending.awaited}
        return Stopped(
            {board: pending.seconds[board] - begun for board, failure in failures.items() if failure is None},
            {board: str(failure) for board, failure in failures.items() if failure is not None},
            tuple(sorted(pending.awaited)),
            tuple(board for board in known if board not in accounted),
        )


def _online(controller: Controller, boards: Sequence[str] | None) -> Iterator[str]:
    """Yield the connected boards of `boards`, of all for None."""
    if boards is None:
        return iter(controller.roster.online)
    return (board for board in boards if (seen := controller.roster.get(board)) is not None and seen.is_online)


async def _send(
    controller: Controller, pending: PendingCommand, stop: Stop, boards: Sequence[str] | None, deadline: float
) -> None:
    """Send the stop to all or to `boards`, and again to each board without an answer, or to all while many are."""
    loop, payload = asyncio.get_running_loop(), msgspec.json.encode(stop)
    topics = [controller.topics.fleet("stop")] if boards is None else [*_topics_of(controller, boards)]
    while loop.time() < deadline:
        left = deadline - loop.time()
        sending = [
            controller.publish(
                each, payload, stop.id, expires=left, deadline=deadline, reply_to=controller.reply_at_once
            )
            for each in topics
        ]
        await asyncio.gather(*sending, return_exceptions=True)  # a lost broker shows in the silent boards
        await asyncio.sleep(_AGAIN)
        pending.expect(_online(controller, boards))
        missing = [board for board in _online(controller, boards) if board in pending.awaited]
        if boards is None and len(missing) > _MANY * len(controller.roster):
            topics = [controller.topics.fleet("stop")]
        else:
            topics = [controller.topics.board(board, "stop") for board in missing]


def _topics_of(controller: Controller, boards: Collection[str]) -> Iterator[str]:
    """Yield the topic of each board; none for a name that no board can have, which must not hold up the others."""
    for board in boards:
        with suppress(InvalidAddress):
            yield controller.topics.board(board, "stop")
