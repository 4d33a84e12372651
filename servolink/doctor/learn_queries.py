"""Queries to measure a board: first contact, unknown ids, turnaround and depth."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count, cycle, islice
from math import sqrt
from typing import Any

from servolink.boards import BoardSettings, Confidence, Measured
from servolink.connection import FENCES, PATIENCE, SURE_COPIES, HandshakeFailed, LineBytes, Mark
from servolink.doctor.contact import connect_in_any_order
from servolink.doctor.learn_line import TRIES, LineRecord, Quality, SharedTransport, TrialLine
from servolink.doctor.line_quality import measure
from servolink.errors import DecodeError, OpenError, RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    HEADER_SIZE,
    OVERHEAD,
    RECORD_TYPES,
    ByteOrder,
    Codec,
    Frame,
    Query,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoParameterRequest,
    QueryServoRequest,
    QueryServoResponse,
    RecordType,
    Response,
    TransmissionModeSettingRequest,
    layout,
)

SHORT_QUERIES: tuple[Query[Response], ...] = (*FENCES, QueryServoListRequest())
"""Queries with short requests and responses, in the order of the attempts."""

_FIRST_PATIENCES = 3  # for the first query of a contact
_SILENT_QUERIES = 2  # before an opening sets mode 1
FEW_REPEATED = 2
"""Second responses that are chance."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Byte order, mode, and queries answered by the board."""

    byte_order: ByteOrder
    answered: tuple[Query[Response], ...]
    """Short queries answered by the board, at least one."""
    mode: int
    """Transmission mode before contact; mode 1 is set now. A board that sent bytes was in mode 1."""
    silent_queries: int
    """Queries in the right byte order left unanswered before mode 1 was set."""
    queries: int = 0
    """Further queries, asked one at a time."""
    repeated: int = 0
    """How many of them were answered twice."""
    copies: int = 0
    """Responses that came again later."""
    slowest: float = 0.0
    """Seconds to the latest of the responses."""
    longer: int = 0
    """Packet id of a response with more content than in the document; 0 without one."""


async def make_contact(transport: SharedTransport, patience: float | None = None) -> Contact:
    """Open the board as `servolink doctor` does, and ask it a few queries. Raise OpenError without an answer.

    The search may take several seconds; `patience` is the time to wait for each response. `transport.settings` are
    complete afterwards.
    """
    longer = 0
    try:
        try:
            connection = await connect_in_any_order(transport, patience=patience or PATIENCE)
        except HandshakeFailed as error:
            if not (longer := error.evidence.longer):
                raise
            order = error.evidence.byte_order
            connection = await connect_in_any_order(transport, order, patience=patience or PATIENCE, ignore_extra=True)
    except HandshakeFailed as error:
        if error.evidence.answered or error.evidence.longer or error.evidence.several or error.evidence.mark:
            raise
        raise OpenError(
            f"{transport.url} does not answer in either byte order or transmission mode: {error}"
        ) from error
    try:
        with suppress(RequestTimeout):  # times the responses of a slow board
            await connection.request(connection.answered[0], timeout=_FIRST_PATIENCES * connection.patience)
        line = await measure(connection, patience)
        mode, silent_queries = (0, _SILENT_QUERIES) if connection.opener.woke else (1, 0)
        contact = Contact(
            connection.codec.byte_order,
            connection.answered,
            mode,
            silent_queries,
            line.requests,
            line.repeated,
            line.copies,
            max(line.round_trips, default=0.0),
            longer,
        )
    finally:
        await connection.close()
    found = {each.setting for each in (*twice_findings(contact), *longer_findings(contact))}
    transport.settings = BoardSettings(
        answers_twice="answers_twice" in found,
        late_copies="late_copies" in found,
        ignore_extra="ignore_extra" in found,
    )
    return contact


def longer_findings(contact: Contact) -> list[Measured]:
    """Return that responses have more content than in the document, if they have."""
    if not contact.longer:
        return []
    text = f"packet {contact.longer} has more content than in the document; the rest is ignored"
    return [Measured("ignore_extra", value=True, confidence="certain", evidence=text)]


def twice_findings(contact: Contact) -> list[Measured]:
    """Return that the board answers twice, or that copies of responses come later, if they do."""
    if contact.copies >= SURE_COPIES:
        text = f"{contact.copies} responses came again later, unchanged"
        return [Measured("late_copies", value=True, confidence="certain", evidence=text)]
    if contact.repeated <= FEW_REPEATED:
        return []
    text = f"{contact.repeated} of {contact.queries} queries were answered twice"
    return [Measured("answers_twice", value=True, confidence="certain", evidence=text)]


def byte_order_finding(contact: Contact, quality: Quality) -> Measured:
    """Return the byte order: with the wrong byte order, a response would not be a frame at all."""
    answered = len(quality.round_trips)
    text = f"{answered} of {quality.sendings} queries in {contact.byte_order} byte order had a readable response"
    return Measured("byte_order", contact.byte_order, "certain" if answered > 1 else "likely", text)


def mode_findings(contact: Contact, quality: Quality, *, power_cycled: bool) -> list[Measured]:
    """Return the mode at power-up, if the board was just switched on, and when mode 1 is to be set."""
    if contact.mode == 1:
        observation = "answered without mode 1 being set"
    else:
        observation = f"left {contact.silent_queries} queries unanswered, and answered as soon as mode 1 was set"
    if not power_cycled:
        text = f"the board {observation}; switch off and on first (--power-cycled) to learn the mode at power-up"
        settings = [Measured("power_up_mode", None, "guess", text)]
        if contact.mode == 0:
            settings.append(
                Measured("transmission_mode", 1, "likely" if quality.is_clean else "guess", f"it {observation}")
            )
        return settings
    confidence: Confidence = "guess"
    if contact.mode == 1 or quality.is_clean:
        confidence = "certain"
    elif quality.loss**contact.silent_queries < 1e-4:
        confidence = "likely"
    text = f"just switched on, the board {observation}"
    return [
        Measured("power_up_mode", contact.mode, confidence, text),
        Measured("transmission_mode", 1 if contact.mode == 0 else "auto", confidence, text),
    ]


MOST_LOSS = 0.15
"""Share of lost queries above which missing answers say nothing about the board."""

ALL_STATES = QueryServoRequest(ALL_SERVOS)
"""Query of the states of all servos."""
_LISTS: tuple[Query[Response], ...] = (
    *(each.list_request for each in RECORD_TYPES),
    QueryServoParameterRequest(),
)
_DEPTHS = (2, 4, 8, 16)
_TRIES_ON_A_BAD_LINE = 16  # long responses are lost more often than responses to the measuring queries
_SHORT = 256  # bytes of a response
_ROUNDS = 8  # bursts of each depth
_MIXED = 2  # bursts out of order needed as evidence; a single burst can be a late response
_LONGEST = 15.0  # seconds, after which no further depth is tried


def name_of(query: Query[Any]) -> str:
    """Return the name of a query in a profile, such as `QueryMemorySize`."""
    return type(query).__name__.removesuffix("Request")


def silence_confidence(quality: Quality, tries: int = TRIES) -> Confidence | None:
    """Return the confidence that a query left unanswered `tries` times is never answered; None: no confidence."""
    if quality.is_clean:
        return "certain"
    if quality.loss > MOST_LOSS:
        return None
    return "likely" if quality.loss**tries < 1e-4 else "guess"


@dataclass(slots=True)
class Survey:
    """Responses of a board to each query."""

    tries: int = TRIES
    """Number of attempts of each query counted as silent."""
    frames: dict[Query[Any], Frame] = field(default_factory=dict)
    """Response to each answered query."""
    silent: list[Query[Any]] = field(default_factory=list)
    """Queries behind which nothing came."""
    garbled: dict[Query[Any], str] = field(default_factory=dict)
    """Description of what came in place of a response of the document, such as `sends text, 'ERR'`, by query."""
    late: list[Query[Any]] = field(default_factory=list)
    """Queries whose response came only with that to a later query."""
    damaged: int = 0
    """Number of tries behind which unreadable bytes came in place of a response that the board has."""
    bridge: Mark | None = None
    """Mark of something on the way that changes bytes, so that silence says nothing of the board."""
    is_separate: bool = False
    """Whether the board lists servos, and returns no state for all of them together."""
    remarks: list[str] = field(default_factory=list)
    """Responses that contradict themselves or each other, in words."""
    responses: dict[Query[Any], Response] = field(default_factory=dict)

    def ids(self, record_type: RecordType[Any]) -> tuple[int, ...] | None:
        """Return the ids of all records of a type, None if unknown."""
        response = self.responses.get(record_type.list_request)
        return None if response is None else record_type.ids_in(response)

    @property
    def servo_ids(self) -> tuple[int, ...] | None:
        """Ids of all servos; None if unknown."""
        response = self.responses.get(QueryServoListRequest())
        return response.servo_id_list if isinstance(response, QueryServoListResponse) else None

    @property
    def memory_total(self) -> int | None:
        """Total memory in the board's own unit, None without a value from the board."""
        response = self.responses.get(QueryMemorySizeRequest())
        return response.total_size if isinstance(response, QueryMemorySizeResponse) else None


async def set_mode_again(line: TrialLine, query: Query[Any]) -> bool:
    """Set mode 1 for a board that answers `query` no more; return whether the board answers again."""
    await line.send(TransmissionModeSettingRequest(1))
    await line.settle()
    return await line.ask(query) is not None


async def survey_board(line: TrialLine, quality: Quality, record: LineRecord, tries: int = TRIES) -> Survey:
    """Send each query until the board answers; queries for a record only if a record is stored.

    `record` is that of the line. A query is sent up to `tries` times, more often on a bad line.
    """
    survey = Survey(_TRIES_ON_A_BAD_LINE if 0 < quality.loss <= MOST_LOSS else tries)
    begun = record.received
    for query in (*SHORT_QUERIES, ALL_STATES, *_LISTS):
        await _survey_query(line, query, survey, record)
    for record_type in RECORD_TYPES:
        if ids := survey.ids(record_type):
            await _survey_query(line, record_type.query(ids[0]), survey, record)
    received = record.beginning + record.since(begun)
    survey.bridge = next((mark for mark in LineBytes(received, line.codec.byte_order).marks() if mark.is_bridge), None)
    if survey.servo_ids and survey.responses.get(ALL_STATES) == QueryServoResponse():
        survey.is_separate = True
        survey.remarks.append(
            f"{name_of(ALL_STATES)} for all servos had no servos, and {len(survey.servo_ids)} are listed"
        )
    return survey


async def _survey_query(line: TrialLine, query: Query[Any], survey: Survey, record: LineRecord) -> None:
    before: Frame | None = None
    begun, rubbish = record.received, 0  # tries behind which something else came
    for _ in range(survey.tries):
        place, asked_at = record.received, asyncio.get_running_loop().time()
        frame = await line.ask(query)
        is_late = record.sent_at - asked_at > line.patience / 2  # something was sent behind the query
        if frame is not None and is_late and query not in survey.late:
            survey.late.append(query)
        if frame is None:
            rubbish += bool(LineBytes(record.since(place), line.codec.byte_order).unread())
            continue
        if query not in _LISTS or frame == before:  # captions and ids must not come from a damaged frame
            break
        before = frame
    else:
        frame = None
    if frame is None and before is None:
        if reason := line.contradictions.get(query.packet_id + 1):
            reason += _other_order(record.since(begun), query, line.codec.byte_order)
            survey.remarks.append(f"{name_of(query)} is answered, and the response contradicts itself: {reason}")
        elif 2 * rubbish > survey.tries:
            survey.garbled[query] = LineBytes(record.since(begun), line.codec.byte_order).described()
            survey.remarks.append(f"{name_of(query)}: the board answers, but {survey.garbled[query]}")
        else:
            survey.silent.append(query)
    elif (frame := frame or before) is not None:
        survey.damaged += rubbish
        survey.frames[query] = frame
        survey.responses[query] = line.decode(frame)


def _other_order(received: bytes, query: Query[Any], byte_order: ByteOrder) -> str:
    """Return that a contradictory response can be read in the other byte order, if it can."""
    other: ByteOrder = "little" if byte_order == "big" else "big"
    for frame in LineBytes(received, byte_order).frames():
        if frame.packet_id == query.packet_id + 1:
            with suppress(DecodeError):
                Codec(other).decode(frame.packet_id, received[frame.start + HEADER_SIZE : frame.end - 1])
                return f"; in {other} byte order its content could be read"
    return ""


def unsupported_finding(survey: Survey, quality: Quality) -> Measured:
    """Return the queries never answered by the board."""
    if survey.bridge is not None:
        text = f"the line {survey.bridge.text}, so what is not answered says nothing of the board"
        return Measured("unsupported", None, "guess", "; ".join((text, *survey.remarks)))
    answered, confidence = len(survey.frames), silence_confidence(quality, survey.tries)
    names = tuple(map(name_of, survey.silent))
    text = f"{answered} queries were answered" if survey.remarks else f"all {answered} queries tried were answered"
    if names:
        text = (
            f"{', '.join(names)}: not answered in {survey.tries} tries each; {answered} others were answered; {quality}"
        )
    else:  # on a bad line, unreadable bytes may be all that the line left of an answer, or of another one
        confidence = "guess" if survey.garbled and not quality.is_clean else "certain"
    if survey.is_separate:
        names += (name_of(ALL_STATES),)  # so that programs read the servos one by one
    value = None if confidence is None else names
    return Measured("unsupported", value, confidence or "guess", "; ".join((text, *survey.remarks)))


async def unknown_ids_finding(line: TrialLine, survey: Survey, quality: Quality, record: LineRecord) -> Measured:
    """Query ids missing in the lists of the board."""
    answered: list[Query[Any]] = []
    silent: list[Query[Any]] = []
    for query in _unknown(survey):
        place = record.received
        is_answered = await line.answer(query) is not None
        if not is_answered and (reason := _unreadable(line, query, record.since(place))):
            return Measured("unknown_ids", None, "guess", f"{_queries([query])}: {reason}")
        (answered if is_answered else silent).append(query)
    observation = " and ".join(
        f"{_queries(queries)} {how}"
        for queries, how in ((answered, "had an empty response"), (silent, f"had none in {TRIES} tries each"))
        if queries
    )
    if not observation:
        return Measured("unknown_ids", None, "guess", "the board lists nothing, so no id is known to be unknown")
    if not silent:
        return Measured("unknown_ids", "empty", "certain", observation)
    confidence = silence_confidence(quality, TRIES * len(silent))
    if answered and confidence is not None:
        confidence = "likely"  # programs must expect both
    value = None if confidence is None else "silent"
    return Measured("unknown_ids", value, confidence or "guess", f"{observation}; {quality}")


def _unreadable(line: TrialLine, query: Query[Any], received: bytes) -> str:
    """Return what came in place of a response to `query`; empty behind silence."""
    if reason := line.contradictions.get(query.packet_id + 1):
        return f"the response contradicts itself: {reason}"
    heard = LineBytes(received, line.codec.byte_order)
    return f"the board answers, but {heard.described()}" if heard.unread() else ""


def _unknown(survey: Survey) -> Iterator[Query[Any]]:
    unsupported = {type(query) for query in survey.silent}
    for record_type in RECORD_TYPES:
        if (ids := survey.ids(record_type)) is not None and record_type.query_class not in unsupported:
            yield record_type.query(next(each for each in count(1) if each not in ids))


def _queries(queries: Sequence[Query[Any]]) -> str:
    return ", ".join(f"{name_of(each)} {getattr(each, each.__struct_fields__[0])}" for each in queries)


def turnaround_finding(query: Query[Any], survey: Survey, quality: Quality, baudrate: int | None) -> Measured:
    """Return the time needed by the board for a short query; `baudrate` is the rate of a serial port, else None."""
    if len(quality.round_trips) < 5:
        return Measured("turnaround", None, "guess", f"{quality}, too many to tell")
    raw = quality.round_trip
    text = f"{name_of(query)} took {raw * 1000:.2f} ms (median of {len(quality.round_trips)})"
    frame = survey.frames.get(query)
    size = 2 * OVERHEAD + layout(type(query), "little").size() + (len(frame[1]) if frame else 0)
    on_wire = size * 10 / baudrate if baudrate else 0.0
    if baudrate and on_wire <= raw:
        text += f", of which {size} bytes at {baudrate} baud take {on_wire * 1000:.2f} ms"
    elif baudrate:
        on_wire = 0.0
        text += f", less than {size} bytes take at {baudrate} baud, so the port is faster"
    spread = max(quality.round_trips) > 3 * raw
    return Measured("turnaround", round(raw - on_wire, 6), "likely" if spread else "certain", text)


async def depth_finding(line: TrialLine, survey: Survey, quality: Quality) -> Measured:
    """Send more and more queries at once until responses are lost, doubled or out of order."""
    queries = _cheap_queries(survey)
    if not queries:
        return Measured("depth", None, "guess", "no short query was answered")
    size = max(OVERHEAD + layout(type(query), "little").size() for query in queries)
    if quality.loss > MOST_LOSS:
        return Measured("depth", None, "guess", f"{quality}, too many for a statement about the board")
    works, observation = 1, ""
    loop = asyncio.get_running_loop()
    end = loop.time() + _LONGEST
    for depth in _DEPTHS:
        if loop.time() > end:
            observation = "more were not tried, as the board is slow"
            break
        burst = list(islice(cycle(queries), depth))
        lost = mixed = 0
        for _ in range(_ROUNDS):
            lost += depth - len(await line.burst(burst))
            await line.settle()
            mixed += not line.answered_in_order(burst)
        if mixed >= _MIXED:
            works, observation = 1, f"{mixed} of {_bursts(depth)} were answered in another order, or more than once"
            break
        if not is_line_loss(lost, depth * _ROUNDS, quality):
            observation = f"{_bursts(depth)} lost {lost} of {depth * _ROUNDS} responses"
            break
        works = depth
    else:
        observation = "more were not tried, without a gain to expect"
    summary = f"{_bursts(works)} of up to {size} bytes were all answered; " if works > 1 else ""
    return burst_finding("depth", works, f"{summary}{observation}; {quality}", line, quality)


def burst_finding(setting: str, value: int, text: str, line: TrialLine, quality: Quality) -> Measured:
    """Return the number of requests answered at once; uncertain if missing responses may have been late."""
    if line.stalls:
        text += "; uncertain, as the board or this machine stopped for seconds meanwhile"
        return Measured(setting, value, "guess", text)
    return Measured(setting, value, "certain" if quality.is_clean else "likely", text)


def is_line_loss(lost: int, sent: int, quality: Quality) -> bool:
    """Return whether a loss is no larger than with single queries, and so caused by the line."""
    expected = quality.loss * sent
    return lost <= (expected + 2 * sqrt(expected) + 1 if expected else 0)


def _bursts(depth: int) -> str:
    return f"{_ROUNDS} bursts of {depth} queries"


def _cheap_queries(survey: Survey) -> list[Query[Any]]:
    """Return queries with short responses, the longest requests first: a board may queue bytes, not requests."""
    by_id = {each.query_class for each in RECORD_TYPES}
    stored = [query for query, (_, content) in survey.frames.items() if type(query) in by_id and len(content) < _SHORT]
    return stored or [query for query in SHORT_QUERIES if query in survey.frames]
