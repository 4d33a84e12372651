"""Stop of all boards of a fleet: a message to each, repeated for each board without an answer."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from typing import Any

import msgspec
from msgspec import Struct

from servolink.errors import ConnectionLost, InvalidAddress
from servolink.fleet.broker import Denied
from servolink.fleet.controller import Controller, new_id
from servolink.fleet.pending_command import PendingCommand, failure_of
from servolink.fleet.topics import Stop

PATIENCE = 5.0
"""Seconds until a board without an answer counts as silent."""
_AGAIN = 1.0  # seconds until the stop is repeated for a board without an answer


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

    Raise ConnectionLost if the broker is gone for as long, and no board is known that could be named, and OpenError
    if it denies this program its topics, and no board is known.
    """
    loop = asyncio.get_running_loop()
    begun, stop = loop.time(), Stop(new_id(), controller.who)
    chosen = None if boards is None else tuple(dict.fromkeys(boards))
    with controller.pending_command(stop.id) as pending:
        pending.expect(_online(controller, chosen))  # a board lost during the stop may still move
        settled, denied = asyncio.Event(), dict[str, str]()
        sending = asyncio.create_task(_send(controller, pending, stop, chosen, begun + patience, settled, denied))
        try:
            try:
                await controller.settle(patience)  # meanwhile the stop is under way
            except (ConnectionLost, Denied):  # not for a moment only: there may be boards unknown here
                if not pending.awaited:
                    raise
            settled.set()
            while True:
                pending.expect(_online(controller, chosen))  # boards join during the stop, too
                if not pending.awaited or await pending.until((), begun + patience):
                    break
        finally:
            sending.cancel()
            await asyncio.wait((sending,))
        failures = {board: failure_of(result) for board, result in pending.results.items()}
        known = [board.name for board in controller.roster] if chosen is None else chosen
        accounted = {*controller.roster.online, *failures, *pending.awaited, *denied}
        if controller.no_answers:
            denied = dict.fromkeys(pending.awaited, controller.no_answers) | denied
        failed = {board: text for board, text in denied.items() if board not in failures}
        return Stopped(
            {board: pending.seconds[board] - begun for board, failure in failures.items() if failure is None},
            failed | {board: str(failure) for board, failure in failures.items() if failure is not None},
            tuple(sorted(pending.awaited - failed.keys())),
            tuple(board for board in known if board not in accounted),
        )


def _online(controller: Controller, boards: Sequence[str] | None) -> Iterator[str]:
    """Yield the connected boards of `boards`, of all for None."""
    if boards is None:
        return iter(controller.roster.online)
    return (board for board in boards if (seen := controller.roster.get(board)) is not None and seen.is_online)


async def _send(
    controller: Controller,
    pending: PendingCommand,
    stop: Stop,
    boards: Sequence[str] | None,
    deadline: float,
    settled: asyncio.Event,
    denied: dict[str, str],
) -> None:
    """Send the stop to `boards`, or to each known board, connected or not, and again to each without an answer.

    Each is sent its own: what all robots may read, each of them could answer for another. Boards that are known once
    `settled` is set follow then. Errors of denied messages are added to `denied`.
    """
    loop, payload = asyncio.get_running_loop(), msgspec.json.encode(stop)
    due_at: dict[str, float] = {}
    while (now := loop.time()) < deadline:
        pending.expect(_online(controller, boards))
        known = [board.name for board in controller.roster] if boards is None else boards
        due = {
            board: topic
            for board in known
            if (board not in due_at or (board in pending.awaited and now >= due_at[board]))
            and (topic := _topic_of(controller, board))
        }
        options: dict[str, Any] = {"expires": deadline - now, "deadline": deadline, "at_once": True}
        # First with QoS 0, twice as quick: its confirmations would be read before the answers of boards.
        sending = [
            controller.publish(topic, payload, qos=1 if board in due_at else 0, **options)
            for board, topic in due.items()
        ]
        due_at |= dict.fromkeys(due, now + _AGAIN)
        outcomes = await asyncio.gather(*sending, return_exceptions=True)  # a lost broker shows in the silent boards
        denied |= {board: str(found) for board, found in zip(due, outcomes, strict=True) if isinstance(found, Denied)}
        if not settled.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(_AGAIN):
                    await settled.wait()
        else:
            await asyncio.sleep(_AGAIN)


def _topic_of(controller: Controller, board: str) -> str | None:
    """Return the topic of a board; None for a name that no board can have, which must not hold up the others."""
    with suppress(InvalidAddress):
        return controller.topics.board(board, "stop")
    return None
