"""Run of a stored action or macro on many boards together: all prepare, and a message starts them."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Literal, TypeVar

import msgspec
from msgspec import UNSET, Struct
from msgspec.structs import replace

from servolink.control import Runnable, encode
from servolink.errors import AmbiguousName, ConnectionLost, NotFound, OutcomeUnknown, ServolinkError, quote
from servolink.fleet.clocks import BoardClocks
from servolink.fleet.controller import Controller, new_id
from servolink.fleet.each import for_each
from servolink.fleet.pending_command import PendingCommand, failure_of, result_as
from servolink.fleet.roster import Roster
from servolink.fleet.start_servos import start_servos
from servolink.fleet.topics import Cancel, Echoed, Prepare, Prepared, Start, Started, Stored

T = TypeVar("T")

Kind = Literal["action", "macro"]

_ECHOES = 3
_ECHO_LIMIT = 1.0  # seconds for a board to answer an echo
_ECHO_TIME = 0.002  # seconds for all echoes of a board
_AT_ONCE = 16  # boards asked at once: of 200 answers at once, the last would seem to have come 40 ms late
_LEAD, _LONGEST_LEAD = 0.3, 0.9  # seconds until the start, for the messages to arrive and all hubs to wait for it
_EACH = 0.0002  # seconds for the message to one more board
_STARTS_AT_ONCE = 64  # messages that the broker has not confirmed
_START_LIMIT = 2.0  # seconds after which a start is of no use


class RanTogether(Struct, frozen=True):
    """Outcome of a run on several boards."""

    started: tuple[str, ...]
    """Boards that have reported the start."""
    held_back: tuple[str, ...]
    """Boards that were ready, and not started because others were not ready."""
    failed: dict[str, str]
    """Error of each failed board: not prepared, or start not confirmed."""
    may_have_started: tuple[str, ...]
    """Boards in `failed` that may have started. Check or stop them."""
    spread: float | None
    """Seconds between the first and the last start; None if unknown, or with fewer than two boards."""
    measured_by: Literal["clock", "echo"] | None
    """`clock`: all boards share a machine, whose clock was read. `echo`: estimated from the delay of messages."""
    duration: float | None
    """Seconds of the longest run; None for macros."""
    idle_servos: dict[str, tuple[int, ...]] = {}
    """Servos of started boards that are stopped or released and do not move."""


def run_for(roster: Roster, board: str, name: int | str, kind: Kind | None) -> Runnable:
    """Return the action or macro `name` of a board, by caption or id.

    Raise NotFound if the board is not there, or has nothing of that name, and AmbiguousName if it has both.
    """
    seen = roster.get(board)
    if seen is None or not seen.is_online:
        raise NotFound(f"{board} is not connected: start `servolink fleet join` on its machine")
    if seen.now is None:
        raise NotFound(f"{board} does not say what is stored on it{': ' if seen.problem else ''}{seen.problem}")
    stored: Mapping[Kind, Sequence[Stored]] = {"action": seen.now.actions, "macro": seen.now.macros}
    kinds: list[Kind] = [each for each in stored if kind in {None, each} and _has(stored[each], name)]
    if not kinds:
        raise NotFound(f"{board} has no {kind or 'action or macro'} {quote(name)}")
    if len(kinds) > 1:
        raise AmbiguousName(f"{board} has an action and a macro {quote(name)}; say which with the type")
    return Runnable(kinds[0], name)


async def run_by_name(
    controller: Controller,
    boards: Iterable[str],
    name: int | str,
    kind: Kind | None,
    *,
    anyway: bool = False,
    start: bool = False,
) -> RanTogether:
    """Run the action or macro `name` of each board, by caption or id, at the same moment.

    All prepare first, and with `start`, start and hold stopped and released servos of the run. If one cannot, nobody
    starts, unless `anyway`: then the others do.
    """
    runs, failed = dict[str, Runnable](), dict[str, ServolinkError]()
    for board in boards:
        try:
            runs[board] = run_for(controller.roster, board, name, kind)
        except ServolinkError as error:
            failed[board] = error
    return await run_together(controller, runs, anyway=anyway, start=start, failed=failed)


def _has(stored: Iterable[Stored], name: int | str) -> bool:
    return any(name in {one.id, one.caption} for one in stored)


async def run_together(
    controller: Controller,
    runs: Mapping[str, Runnable],
    *,
    anyway: bool = False,
    start: bool = False,
    failed: Mapping[str, ServolinkError] | None = None,
) -> RanTogether:
    """Prepare every board for the run, and start all with a message.

    With `start`, start and hold stopped and released servos of the run, once all boards are prepared. If a board cannot
    prepare, or is in `failed` already, nobody starts, unless `anyway`: then the others do.
    """
    start_id = new_id()
    words = {board: seen.pulse if (seen := controller.roster.get(board)) else None for board in runs}
    patience = controller.patience
    expires = min(60.0, patience * (2 if start else 1) + _seconds_to_compare(len(runs)))

    async def prepare(board: str) -> Prepared:
        found = await controller.call(board, "prepare", Prepare(start_id, runs[board], expires))
        return result_as(board, found, Prepared)

    async def start_idle(board: str) -> Prepared:
        await start_servos(controller, board, runs[board], words[board])
        return replace(prepared.done[board], idle_servos=())

    prepared = await for_each(runs, prepare, parallel=len(runs))
    ready, problems = prepared.done, {**(failed or {}), **prepared.failed}
    if start and ready and (anyway or not problems):
        begun = await for_each(ready, start_idle, parallel=_AT_ONCE)
        if anyway:
            await _cancel(controller, start_id, begun.failed)
        ready, problems = begun.done, problems | begun.failed
    if not ready or (problems and not anyway):
        await _cancel(controller, start_id, prepared.done)
        texts = {board: str(error) for board, error in problems.items()}
        return RanTogether((), tuple(sorted(ready)), texts, (), None, None, None)
    clocks = await compare_clocks(controller, ready)
    with controller.pending_command(start_id) as pending:
        loop = asyncio.get_running_loop()
        lead = _LEAD + _EACH * len(ready) + max(clocks.delays.values(), default=0.0)
        moments = clocks.moments(loop.time() + min(lead, _LONGEST_LEAD))
        denied = await start_each(controller, start_id, ready, moments)
        await pending.until(set(ready) - set(denied), loop.time() + patience)
        return _result(pending, ready, {**problems, **denied}, clocks.delays)


async def start_each(
    controller: Controller, start: str, boards: Iterable[str], moments: Mapping[str, float]
) -> dict[str, ServolinkError]:
    """Start the runs prepared for `start`, each at the moment of its board. Return the errors of denied messages.

    Each board has a message of its own: one for all would name each board, and be sent to each of them.
    """
    loop = asyncio.get_running_loop()
    ends = loop.time() + _START_LIMIT

    async def send(board: str) -> None:
        topic, payload = controller.topics.board(board, "start"), Start(start, controller.who, moments.get(board))
        with suppress(ConnectionLost):  # the broker may have the message: answers show the started boards
            left = ends - loop.time()
            await controller.publish(topic, encode(payload), expires=left, deadline=ends)

    return (await for_each(boards, send, parallel=_STARTS_AT_ONCE)).failed


async def _cancel(controller: Controller, start: str, boards: Iterable[str]) -> None:
    """Cancel the prepared start on boards, which frees their leases."""
    await for_each(boards, lambda board: controller.call(board, "cancel", Cancel(start), patience=1.0), parallel=64)


def _seconds_to_compare(boards: int) -> float:
    """Return the longest time to compare the clocks of so many boards, in seconds."""
    return 2 * _ECHO_LIMIT + _ECHO_TIME * boards


async def compare_clocks(controller: Controller, boards: Iterable[str]) -> BoardClocks:
    """Return the differences between the clocks of boards, by some round trips of a message."""

    def host_of(board: str) -> str:
        seen = controller.roster.get(board)
        return board if seen is None or seen.now is None else seen.now.host

    loop, answering = asyncio.get_running_loop(), list(boards)
    clocks, ends = BoardClocks(host_of), loop.time() + _seconds_to_compare(len(answering))

    async def echo(board: str) -> bool:
        """Take an echo of a board. Return whether there was one."""
        if loop.time() >= ends:
            return False
        message_id = new_id()
        with controller.pending_command(message_id, board=board) as pending:
            sent = loop.time()
            await controller.echo(controller.topics.board(board, "echo"), message_id, expires=_ECHO_LIMIT)
            await pending.until((board,), sent + _ECHO_LIMIT)
            result = pending.results.get(board)
            if result is None or (echoed := _as(result.result, Echoed)) is None:
                return False
            clocks.heard(board, sent, echoed.monotonic, pending.seconds[board])
            return True

    for _ in range(_ECHOES):
        echoes = await for_each(answering, echo, parallel=_AT_ONCE)
        for error in echoes.failed.values():
            raise error
        answering = [board for board, has_answered in echoes.done.items() if has_answered]
    return clocks


def _result(
    pending: PendingCommand,
    prepared: Mapping[str, Prepared],
    problems: Mapping[str, ServolinkError],
    delays: Mapping[str, float],
) -> RanTogether:
    started: dict[str, Started] = {}
    failed = dict(problems)
    for board in prepared:
        result = pending.results.get(board)
        if result is None:
            text = f"{board} was prepared, and has not reported a start: look at the board"
            failed.setdefault(board, OutcomeUnknown(text))  # unless the start was denied
        elif (failure := failure_of(result)) is not None:
            failed[board] = failure
        elif (moment := _as(result.result, Started)) is None:
            failed[board] = OutcomeUnknown(f"{board} has started, and sent an unreadable result")
        else:
            started[board] = moment
    spread, measured_by = _spread(started, pending, delays)
    durations = [one.seconds for board, one in prepared.items() if board in started and one.seconds is not None]
    texts = {board: str(error) for board, error in failed.items()}
    idle = {board: prepared[board].idle_servos for board in sorted(started) if prepared[board].idle_servos}
    unknown = tuple(sorted(board for board in prepared if isinstance(failed.get(board), OutcomeUnknown)))
    longest = max(durations, default=None)
    return RanTogether(tuple(sorted(started)), (), texts, unknown, spread, measured_by, longest, idle)


def _as(value: object, kind: type[T]) -> T | None:
    try:
        return None if value is UNSET else msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return None


def _spread(
    started: Mapping[str, Started], pending: PendingCommand, delays: Mapping[str, float]
) -> tuple[float | None, Literal["clock", "echo"] | None]:
    """Return the seconds between the first and the last start, and the method of measuring."""
    if len(started) < 2:
        return None, None
    if len({one.host for one in started.values()}) == 1:
        moments = [one.monotonic for one in started.values()]
        return max(moments) - min(moments), "clock"
    # A result takes half an echo to arrive here, so the board had started earlier by as much.
    moments = [pending.seconds[board] - delays[board] for board in started]
    spread = max(moments) - min(moments)
    return (spread, "echo") if math.isfinite(spread) else (None, None)
