"""Conversation: the responses of a board to each kind of query, to several at once, and after a pause."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from itertools import cycle, islice
from typing import Any

from servolink.connection import LineBytes
from servolink.doctor.finding import Finding
from servolink.doctor.learn_line import Quality, SharedTransport, TrialLine
from servolink.doctor.learn_queries import ALL_STATES, Survey, name_of, set_mode_again, survey_board
from servolink.doctor.line_quality import LineCounts
from servolink.motion import doubts
from servolink.protocol import (
    ByteOrder,
    Codec,
    Query,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    Response,
)

FORGETS = "transmission mode"
"""Finding about a board that falls back to the old mode."""

_TRIES = 3  # of a query, on a line without losses
_PAUSE = 2.5  # seconds without a request, in which some boards fall asleep or forget their mode
_DROWSY = 0.3  # seconds without a request before the second try to wake a board
_DEPTH, _ROUNDS = 4, 2  # queries at once, and how often
_SHORTEST, _LONGEST = 0.15, 2.0  # seconds of patience
_FULL = 1000  # per mille
_MOST_SINGLE = 8  # servos asked singly
_CABLES = "check the cables of the servos"
_SHOW = "update the firmware, or show this to its maker"
_FEW = 1  # damaged responses on a line that seemed good


async def converse(
    transport: SharedTransport, answered: Sequence[Query[Response]], byte_order: ByteOrder, line: LineCounts
) -> tuple[Survey | None, list[Finding]]:
    """Ask the board of a contact each kind of query, and return the responses with what is wrong about them.

    None for a board that answers nothing after a pause. Nothing else may use `transport` meanwhile.
    """
    trips = tuple(line.round_trips)
    async with TrialLine(transport, Codec(byte_order)) as trial:
        trial.patience = max(_SHORTEST, min(_LONGEST, 2 * max(trips, default=_LONGEST)))
        trial.use_fences(answered)
        pause = await after_pause(transport, trial, answered[0])
        if pause is not None and pause.check != FORGETS:
            return None, [pause]
        quality = Quality(line.requests, trips[: line.requests - line.unanswered])
        survey = await survey_board(trial, quality, transport.record, _TRIES)
        if (mark := survey.bridge) is not None:
            return survey, [Finding(mark.name, f"the line {mark.text}", mark.meaning, mark.remedy)]
        findings = [*([] if pause is None else [pause]), *_contents(survey), *_losses(survey)]
        findings += [*await _servos(trial, survey), *_impossible(survey)]
        if not (line.unanswered or line.noise_bytes or findings) and not await _takes_several(trial, answered):
            findings.append(_ONE_AT_A_TIME)
    return survey, findings


async def after_pause(transport: SharedTransport, trial: TrialLine, query: Query[Response]) -> Finding | None:
    """Ask after a pause; return why there is no answer."""
    loop = asyncio.get_running_loop()
    await asyncio.sleep(max(0.0, transport.record.sent_at + _PAUSE - loop.time()))
    for _ in range(_TRIES):  # a response may be late by chance
        if await trial.ask(query) is not None:
            return None
        await trial.settle()
    comes_late = bool(transport.record.pause)  # of a pause inside frames, and not of sleep or mode
    if not comes_late and await _is_woken(trial, query):
        return Finding(
            "sleep",
            "after a pause, a single query is not answered, and of two queries in a row the second one is",
            "the board, adapter or bridge sleeps after a pause, and the first bytes that wake it are lost; each "
            "request after a pause may be lost, a stop too",
            "switch off sleep or power saving in the firmware, adapter or bridge",
        )
    if not comes_late and await set_mode_again(trial, query):
        return Finding(
            FORGETS,
            "after a pause, the board answers only when mode 1 is set again",
            "the board falls back to the old mode when nothing is sent to it for seconds; servolink sets mode 1 again "
            "where requests are not answered",
            "update the firmware, or leave the mode of the board fixed to 1",
        )
    return Finding(
        "pause",
        f"the board answered query after query, and after a pause of {_PAUSE:g} s it answers nothing",
        "the board, adapter or bridge sleeps or has ended",
        "switch off sleep or power saving in the firmware, adapter or bridge\nswitch the board off and on",
    )


async def _is_woken(trial: TrialLine, query: Query[Response]) -> bool:
    """Return whether, again and again, one query is not answered and one of two in a row is."""
    for _ in range(_ROUNDS):
        if not await trial.burst([query, query]):
            return False
        await asyncio.sleep(_DROWSY)
        if await trial.ask(query) is not None:
            return False
    return True


def _contents(survey: Survey) -> Iterator[Finding]:
    """Report responses that cannot be read: contradictory ones, and ones that the document does not have."""
    remarks = survey.remarks[:-1] if survey.is_separate else survey.remarks
    if remarks and not survey.garbled:
        yield Finding(
            "contradiction",
            "; ".join(remarks),
            "the response is intact, and says different things: programs cannot use it",
            _SHOW,
        )
    if survey.garbled:
        texts = dict.fromkeys(survey.garbled.values())
        names = {
            text: ", ".join(name_of(query) for query, said in survey.garbled.items() if said == text) for text in texts
        }
        yield Finding(
            "responses",
            "; ".join(f"{names[text]}: the board answers, but {text}" for text in texts),
            "the board answers in a form that the document does not have, so programs cannot read it",
            _SHOW,
        )


def _losses(survey: Survey) -> Iterator[Finding]:
    """Report responses that come late, or damaged now and then."""
    if survey.late:
        yield Finding(
            "responses",
            f"{', '.join(map(name_of, survey.late))}: the response came late, with that to a later query",
            "an adapter, bridge or the firmware holds responses back until more is sent, or the board is busy",
            "set the adapter or bridge to send at once what it receives\nstop macros and motions of the board",
        )
    if survey.damaged > _FEW:
        yield Finding(
            "noise",
            f"{survey.damaged} responses, of those to each kind of query, came damaged",
            "the line damages bytes, above all in long responses",
            "try a shorter cable, another port without a hub, and a separate power supply for the servos",
        )


async def _servos(trial: TrialLine, survey: Survey) -> list[Finding]:
    """Compare the response for all servos with the list of servos, and ask those that are left out singly."""
    listed, states = survey.servo_ids, survey.responses.get(ALL_STATES)
    if listed is None:
        return []
    if not listed:
        text = "the board lists no servos"
        return [Finding("servos", text, "no servo can be moved", f"{_CABLES}, and their power supply")]
    reported = {state.servo_id for state in states.servos} if isinstance(states, QueryServoResponse) else set[int]()
    missing = sorted(set(listed) - reported) if states is not None or ALL_STATES in survey.silent else []
    if not missing:
        return []
    mute = [servo_id for servo_id in missing[:_MOST_SINGLE] if not await _reports(trial, servo_id)]
    if mute:
        who = f"servo {mute[0]} is" if len(mute) == 1 else f"servos {', '.join(map(str, mute))} are"
        return [
            Finding(
                "servos",
                f"{who} in the list of the board, and not reported, asked singly either",
                "the board does not reach the servo: its cable, its power or its id; it does not move",
                f"{_CABLES}, and their ids",
            )
        ]
    return [
        Finding(
            "servos",
            f"the response for all servos had {len(reported)} of the {len(listed)} servos in the list, without "
            f"{', '.join(map(str, missing))}",
            "programs read the servos that are left out one by one, which takes longer",
            "",
            is_harmless=True,
        )
    ]


async def _reports(trial: TrialLine, servo_id: int) -> bool:
    """Return whether a servo that is asked singly reports under its own id."""
    for _ in range(_TRIES):
        frame = await trial.ask(QueryServoRequest(servo_id))
        response = None if frame is None else trial.decode(frame)
        if isinstance(response, QueryServoResponse):
            return any(state.servo_id == servo_id for state in response.servos)
    return False


def _impossible(survey: Survey) -> Iterator[Finding]:
    """Report values that cannot be true: of servos, of the charge and of the memory."""
    states = survey.responses.get(ALL_STATES)
    servos = states.servos if isinstance(states, QueryServoResponse) else ()
    found = doubts(servos, lambda _: None, compares=True)
    if found:
        shown = "; ".join(f"servo {servo_id}: {doubt}" for servo_id, doubt in found.items())
        is_some = len(found) < len(servos)
        yield Finding(
            "impossible values",
            f"the states of {len(found)} of {len(servos)} servos cannot be true: {shown}",
            "the board does not reach these servos, and fills in what it does not know; programs mark their values, "
            "and start no movement from them"
            if is_some
            else "the firmware has another form of states, or does not measure; programs mark the values, and start "
            "no movement from them",
            f"{_CABLES}, their ids and their power supply" if is_some else _SHOW,
        )
    power = survey.responses.get(QueryRemainPowerRequest())
    memory = survey.responses.get(QueryMemorySizeRequest())
    if isinstance(power, QueryRemainPowerResponse) and not -1 <= power.permil <= _FULL:
        text = f"the charge of the battery is {power.permil / 10:g} %"
        yield Finding("impossible values", text, "the firmware reports it in another unit", _SHOW, is_harmless=True)
    if isinstance(memory, QueryMemorySizeResponse) and memory.size > (memory.total_size or memory.size) >= 0:
        text = f"{memory.size} of memory are free, of {memory.total_size} in all"
        yield Finding("impossible values", text, "the firmware counts them differently", _SHOW, is_harmless=True)


_ONE_AT_A_TIME = Finding(
    "one at a time",
    f"of {_DEPTH} queries sent at once, some were not answered, or not in order",
    "the board takes one request at a time; programs send the next one after each response, as long as `depth` is 1, "
    "which it is unless more was learnt",
    "",
    is_harmless=True,
)


async def _takes_several(trial: TrialLine, answered: Sequence[Query[Any]]) -> bool:
    """Return whether all of several queries at once are answered, in one of several rounds."""
    burst: list[Request[Response]] = list(islice(cycle(answered), _DEPTH))
    for _ in range(_ROUNDS):
        answers = await trial.burst(burst)
        await trial.settle()
        if len(answers) == _DEPTH and trial.answered_in_order(burst):
            return True
    return False


def check_received(beginning: bytes, byte_order: ByteOrder, findings: Sequence[Finding]) -> Iterator[Finding]:
    """Find a bridge by the first bytes of a line, unless it is among the findings."""
    for mark in LineBytes(beginning, byte_order).marks()[:1]:
        if mark.is_bridge and all(finding.check != mark.name for finding in findings):
            yield Finding(mark.name, f"the line {mark.text}", mark.meaning, mark.remedy)
