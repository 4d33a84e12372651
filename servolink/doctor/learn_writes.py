"""Board properties visible only by writing: memory unit, effect of adding and clearing, depth of the write queue."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress

from msgspec.structs import replace

from servolink.boards import Measured
from servolink.client import Board
from servolink.doctor.learn_line import Quality, TrialLine
from servolink.doctor.learn_queries import burst_finding, is_line_loss
from servolink.doctor.learn_trial import SCRATCH, Trial, write_marker
from servolink.errors import OutcomeUnknown, Rejected, RequestTimeout
from servolink.project import without_neutral
from servolink.protocol import (
    ACTION,
    OVERHEAD,
    RECORD_TYPES,
    Action,
    ClearAllDataRequest,
    Query,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    Response,
    ServoParameter,
)

_TRIES = 3
_DEPTHS = (2, 4, 8)
_ROUNDS = 3  # bursts of each depth
_MOST_RECORDS = 128
_ENOUGH_BYTES = 5 * 1024  # bytes written to recognise a unit of 1,024 bytes in spite of rounding
_FEWEST_UNITS = 3
_PERCENT = 100  # total memory of a board that reports shares
_LONGEST = 60.0  # seconds for storing records
_LONGEST_CLEARING = 180.0  # seconds
_NEAR = (0.5, 2.0)  # a unit fits if the bytes written are explained within these factors


async def project_id_finding(board: Board, trial: Trial) -> Measured:
    """Write the marker of an unfinished import, an id of 32 bits, and read back the bits kept by the board."""
    marker, before = trial.journal.marker, trial.content.project_id
    found = await write_marker(board, marker)
    text = f"{marker:#x} was written and {found:#x} read back"
    for bits, expected in ((32, marker), (16, marker & 0xFFFF), (0, 0), (0, before)):
        if found in (expected, expected - 0x10000 if bits == 16 else expected):
            is_sure = found == (await board.request(QueryProjectIDRequest())).project_id
            return Measured("project_id_bits", bits, "certain" if is_sure else "likely", text)
    return Measured("project_id_bits", None, "guess", f"{text}, neither 32, 16 nor 0 bits")


async def memory_finding(board: Board, trial: Trial) -> Measured:
    """Store records of known size until the free memory has changed enough, and compare."""
    try:
        reported = await board.request(QueryMemorySizeRequest())
    except RequestTimeout:
        return Measured("memory_unit", None, "guess", "the board does not say how much memory is free")
    before = free = reported.size
    if reported.total_size == _PERCENT:
        return Measured("memory_unit", None, "guess", "the board reports 100 for total memory, which may be percent")
    if before < 0:
        return Measured("memory_unit", None, "guess", f"the board reports {before} for free memory")
    written = 0
    loop = asyncio.get_running_loop()
    end = loop.time() + _LONGEST
    for _ in range(_MOST_RECORDS):
        (action,) = trial.scratch_actions(1)
        if not await _store(board, action):
            break
        written += ACTION.size(action)
        free = (await board.request(QueryMemorySizeRequest())).size
        used = before - free
        if written >= _ENOUGH_BYTES or (used >= _FEWEST_UNITS and _fits(1, used, written)) or loop.time() > end:
            break
    await _delete_scratch(board, trial)
    if not written:
        return Measured("memory_unit", None, "guess", "the board stores no more records")
    used = before - free
    text = f"records of {written:,} bytes in all took {used:,} of {before:,} free units"
    fitting = [unit for unit in (1, 1024) if _fits(unit, used, written)]
    if len(fitting) == 1 and used >= _FEWEST_UNITS:
        return Measured("memory_unit", fitting[0], "certain", text)
    if fitting:
        return Measured("memory_unit", fitting[0], "likely", f"{text}; more could not be stored")
    return Measured("memory_unit", None, "guess", f"{text}, neither bytes nor KiB")


def _fits(unit: int, used: int, written: int) -> bool:
    return used > 0 and _NEAR[0] <= used * unit / written <= _NEAR[1]


async def duplicate_finding(board: Board, trial: Trial) -> Measured:
    """Add records with ids already stored, and read the resulting records."""
    observations = [await _added_twice(board, action) for action in trial.scratch_actions(2)]
    await _delete_scratch(board, trial)
    value, text = observations[0]
    if value is None or observations[1][0] != value:
        texts = text if observations[1][1] == text else f"{text}; another time {observations[1][1]}"
        return Measured("on_duplicate", None, "guess", f"two records were each added twice: {texts}")
    return Measured("on_duplicate", value, "certain", f"two records were each added twice: {text}")


async def _store(board: Board, action: Action) -> bool:
    """Store an action, and return whether the action is stored; after a lost response, read the list."""
    for _ in range(_TRIES):
        try:
            return bool((await board.request(ACTION.add(action))).result)
        except OutcomeUnknown:
            if action.action_id in [entry.action_id for entry in await board.actions()]:
                return True
    return False


async def _delete_scratch(board: Board, trial: Trial) -> None:
    """Delete scratch records, to make room for others; the end of the trial deletes the rest."""
    content_ids = {action.action_id for action in trial.content.actions}
    for entry in await board.actions():
        if entry.action_id not in content_ids:
            with suppress(OutcomeUnknown, Rejected):
                await board.delete_action(entry.action_id)
    trial.free_ids({entry.action_id for entry in await board.actions()})


async def _added_twice(board: Board, action: Action) -> tuple[str | None, str]:
    """Return the effect of adding an action again, and a text of the observation."""
    if not await _store(board, action):
        return None, "the board stores no more records"
    again = replace(action, action_caption=f"{SCRATCH} 2")
    is_accepted: bool | None = None
    with suppress(OutcomeUnknown):
        is_accepted = bool((await board.request(ACTION.add(again))).result)
    listed = [entry.action_id for entry in await board.actions()].count(action.action_id)
    caption = (await board.action(action.action_id)).action_caption
    is_new = caption == again.action_caption
    answer = "no answer" if is_accepted is None else "yes" if is_accepted else "no"
    times = {1: "once", 2: "twice"}.get(listed, f"{listed} times")
    text = f"the board said {answer}, lists the id {times} and returns the {'new' if is_new else 'old'} record"
    if listed > 1:
        return "append", text
    if is_new:
        return "replace", text
    return ("reject" if is_accepted is False else None), text


async def write_depth_finding(trial: Trial, quality: Quality, fences: Sequence[Query[Response]]) -> Measured:
    """Store more and more records at once until some are lost; `fences` are short queries that the board answers."""
    works, observation = 1, ""
    size = max(OVERHEAD + ACTION.size(action) for action in trial.scratch_actions(1))
    async with TrialLine(trial.transport, trial.codec) as line:
        line.patience = max(line.patience, 4 * quality.round_trip)
        line.use_fences(fences)
        for depth in _DEPTHS:
            lost = 0
            for _ in range(_ROUNDS):
                missing = await _missing_of(line, trial.scratch_actions(depth))
                if missing is None:
                    observation = f"in a burst of {depth} the board refused a record, or did not list all"
                    text = f"{_works(works, size)}{observation}; {quality}"
                    return Measured("write_depth", works if works > 1 else None, "guess", text)
                lost += missing
            if not is_line_loss(lost, depth * _ROUNDS, quality):
                observation = f"{_ROUNDS} bursts of {depth} lost {lost} of {depth * _ROUNDS}; "
                break
            works = depth
    return burst_finding("write_depth", works, f"{_works(works, size)}{observation}{quality}", line, quality)


def _works(depth: int, size: int) -> str:
    return f"{_ROUNDS} bursts of {depth} records of {size} bytes were all stored; " if depth > 1 else ""


async def _missing_of(line: TrialLine, actions: Sequence[Action]) -> int | None:
    """Store `actions` together, and return the number missing in the list; None after a refusal or without a list."""
    frames = await line.burst([ACTION.add(action) for action in actions])
    if any(not getattr(line.decode(frame), "result", 0) for frame in frames):
        return None
    await line.settle()
    response = await line.answer(ACTION.list_request)
    if response is None:
        return None
    return len({action.action_id for action in actions} - set(ACTION.ids_in(response)))


async def clear_findings(board: Board, trial: Trial) -> list[Measured]:
    """Clear the board, and report the remaining content and the time. The caller has consent."""
    loop = asyncio.get_running_loop()
    if not await _store(board, trial.scratch_actions(1)[0]):
        return [Measured("clear", None, "guess", "the board stores no more records, so nothing was cleared")]
    marked_id = (await board.request(QueryProjectIDRequest())).project_id
    if marked_id == trial.content.project_id:
        marked_id = 0  # the board keeps no project ids, so clearing shows nothing there
    await trial.note("clearing")
    begun = loop.time()
    try:
        is_accepted: bool | None = bool((await board.request(ClearAllDataRequest(), timeout=_LONGEST_CLEARING)).result)
    except OutcomeUnknown:
        is_accepted = None
    seconds = loop.time() - begun
    found = (await board.request(QueryProjectIDRequest())).project_id
    parameters = await board.servo_parameters()
    remaining = sum([len(each.ids_in(await board.request(each.list_request))) for each in RECORD_TYPES])
    await write_marker(board, trial.journal.marker)
    await trial.note("writing")
    if remaining or is_accepted is False:
        observation = f"the board said {'no' if is_accepted is False else 'yes'} and lists {remaining} records"
        return [Measured("clear", None, "guess", f"after clearing {observation}")]
    return [_clear_finding(trial, marked_id, found, parameters), _clear_time(seconds, is_accepted)]


def _clear_finding(trial: Trial, before: int, after: int, parameters: Sequence[ServoParameter]) -> Measured:
    had = len(without_neutral(trial.content.servo_parameters))
    has = len(without_neutral(parameters))
    observations = [f"project id {'kept' if after == before else 'deleted'}" if before else "no project id to see"]
    observations.append(f"{has} of {had} servo parameters kept" if had else "no servo parameters to see")
    survived = [after == before] * bool(before) + [has == had] * bool(had)
    text = f"all records deleted, {', '.join(observations)}"
    if not survived or len({*survived}) > 1 or (not survived[0] and (has or after)):
        return Measured("clear", None, "guess", text)
    return Measured("clear", "records" if survived[0] else "all", "certain" if len(survived) == 2 else "likely", text)


def _clear_time(seconds: float, is_accepted: object) -> Measured:
    if is_accepted is None:
        return Measured("clear_seconds", None, "guess", f"cleared, but not confirmed within {seconds:.1f} s")
    text = f"the response to clearing came after {seconds:.3f} s"
    return Measured("clear_seconds", round(seconds, 3), "likely", text)
