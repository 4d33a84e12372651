"""Fences: queries with short responses, the choice of the next one, and which of them a board answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from random import Random
from typing import Any, TypeAlias

from servolink.connection.call import Lane
from servolink.connection.stats import Stats
from servolink.errors import DecodeError
from servolink.protocol import (
    ALL_SERVOS,
    RECORD_TYPES,
    Codec,
    Packet,
    Query,
    QueryActiveJoystickTableRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    QueryServoResponse,
    Response,
)

FENCES: tuple[Query[Any], ...] = (
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryRemainPowerRequest(),
    QueryActiveJoystickTableRequest(),
)
"""Queries with short responses, which settle what was sent before them."""

SERVO_LIST = QueryServoListRequest()
LISTS: tuple[Query[Any], ...] = (SERVO_LIST, *(each.list_request for each in RECORD_TYPES))
"""Queries whose responses name servos or records, each of which can be asked for."""
RESERVES: tuple[Query[Any], ...] = (SERVO_LIST, QueryServoRequest(ALL_SERVOS))
"""Fences for boards that answer fewer than two of FENCES."""
Kind: TypeAlias = "Query[Any] | int"
"""A short query, or the id of any other response."""

_MOST_OF_A_KIND = 4  # servos or records asked for
_SAME_FENCE = 3  # sendings in a silence: perhaps the board does not support the query


class FenceChoice:
    """Choice of the next fence to be sent."""

    def __init__(self, lanes: Mapping[int, Lane], stats: Stats) -> None:
        """Choose by the open slots of `lanes`, by response id."""
        self.queries = FENCES
        """Queries known to be answered, used in turn."""
        self._lanes = lanes
        self._stats = stats
        self._latest = FENCES[0]
        self._tries = 0  # sendings of the latest in a row
        self._sent_at = -1  # frames received when the latest was sent

    def use(self, queries: tuple[Query[Any], ...]) -> None:
        """Use `queries` from now on, at least one query."""
        self.queries = queries
        if self._latest not in queries:
            self._latest = queries[0]

    def next(self, packet: Packet) -> Query[Any]:
        """Return the next fence, on another lane than `packet`, and count it as sent."""
        self._stats.fences += 1
        received, self._sent_at = self._sent_at, self._stats.frames_received
        same = received == self._sent_at and self._latest.packet_id != packet.packet_id
        if not same or self._tries == _SAME_FENCE:
            self._latest = self._another(packet)
            self._tries = 0
        self._tries += 1
        # In a silence the same fence is sent again: the first response proves everything older than the first sending.
        return self._latest

    def any_but(self, packet: Packet, chance: Random) -> Query[Any]:
        """Return a fence by chance, on another lane than `packet`: copies of its response are not in step with it."""
        self._stats.fences += 1
        return chance.choice([each for each in (*self.queries, SERVO_LIST) if each.packet_id != packet.packet_id])

    def _another(self, packet: Packet) -> Query[Any]:
        """Return the fence whose response will settle the most; not the latest, if there are others.

        On an idle lane it is exact and settles everything. Elsewhere it belongs to the oldest slot of the lane, and
        settles what is older than that; where this slot is the youngest, other lanes become idle.
        """
        self.queries = (*self.queries[1:], self.queries[0])
        others = {packet.packet_id, self._latest.packet_id}
        fences = [fence for fence in (*self.queries, SERVO_LIST) if fence.packet_id not in others]
        return max(fences or [self._latest], key=self._settled_until)

    def _settled_until(self, fence: Query[Any]) -> float:
        """Return the time up to which a response to `fence` will settle all sendings."""
        slots = self._lanes[fence.packet_id + 1].slots
        return slots[0].sent_at if slots else float("inf")


class ShortQueries:
    """Short queries during an opening: which were sent, and which of them the board answers."""

    def __init__(self, unsupported: Collection[str]) -> None:
        """Begin with FENCES, except those `unsupported`, which are named without `Request`."""
        self.kinds: list[Kind] = list(FENCES)
        """Queries of the handshake, unsupported ones included."""
        self.unsupported: set[Kind] = {query for query in FENCES if query.short_name in unsupported}
        """Queries that the board is known not to answer."""
        self.unasked = [query for query in LISTS if query.short_name not in unsupported]
        """Lists to be asked for if kinds are lacking."""
        self.named: dict[Query[Any], list[Query[Any]]] = {}
        """Queries about what an answered list names, by list."""
        self.sent: Counter[Kind] = Counter()
        self.answered: Counter[Kind] = Counter()
        self.differ = False
        """Whether two responses with the same id had different contents."""
        self._contents: dict[int, bytes] = {}  # first one by packet id
        self._asleep: set[Kind] = set()  # queries without an answer before the mode setting, the first to have one

    def origin(self, packet_id: int, content: bytes, codec: Codec) -> Kind:
        """Return the query that a response answers, else its id."""
        self.differ |= self._contents.setdefault(packet_id, content) != content
        queries = [each for each in (*self.kinds, *LISTS) if not isinstance(each, int)]
        queries = [each for each in queries if each.packet_id + 1 == packet_id]
        if not queries or queries[0] in FENCES:
            return queries[0] if queries else packet_id
        try:
            response = codec.decode(packet_id, content)
        except DecodeError:
            return packet_id
        assert isinstance(response, Response)  # noqa: S101 - its id is that of a response
        kind = next((each for each in queries if names(response, each)), None)
        if kind in LISTS:
            self.named[kind] = queries_about(response)
        return packet_id if kind is None else kind

    def wake(self) -> None:
        """Note that the mode setting was answered before all queries sent so far."""
        self._asleep = set(self.sent)

    @property
    def has_woken(self) -> bool:
        """Whether queries were answered only behind the mode setting: the board seems to have been in mode 0."""
        return any(self.answered[kind] for kind in self._asleep)

    @property
    def packet_ids(self) -> frozenset[int]:
        """Packet ids of all queries that may have been sent."""
        return frozenset(kind if isinstance(kind, int) else kind.packet_id for kind in (*self.kinds, *self.sent))

    @property
    def answered_ones(self) -> tuple[Query[Any], ...]:
        """Short queries that the board has answered."""
        return tuple(query for query in (*FENCES, SERVO_LIST) if self.answered[query])

    def known(self) -> list[Kind]:
        """Return all queries so far that the board answers, as far as it is known."""
        found: dict[Kind, None] = dict.fromkeys(kind for kind in self.kinds if kind not in self.unsupported)
        for listed, named in self.named.items():
            found |= dict.fromkeys((listed, *(each for each in named if each not in self.unsupported)))
        return list(found)

    def fences(self, silent: set[Kind]) -> tuple[Query[Any], ...]:
        """Return at least two fences for a connection: FENCES, or those that are answered if some are `silent`."""
        if not silent | self.unsupported:
            return FENCES
        fences = tuple(query for query in FENCES if self.answered[query])
        return fences if len(fences) > 1 else (*fences, *RESERVES)

    def unanswered(self, silent: set[Kind]) -> frozenset[str]:
        """Return the names of queries that the board does not answer, the `silent` ones included."""
        return frozenset(query.short_name for query in (*FENCES, *LISTS) if query in silent | self.unsupported)


def queries_about(response: Response) -> list[Query[Any]]:
    """Return queries of the first servos or records that are named in the response to one of LISTS."""
    if isinstance(response, QueryServoListResponse):
        ids = [each for each in dict.fromkeys(response.servo_id_list) if each != ALL_SERVOS]
        return [QueryServoRequest(each) for each in ids[:_MOST_OF_A_KIND]]
    record_type = next(each for each in RECORD_TYPES if each.list_request.packet_id + 1 == response.packet_id)
    ids = [each for each in dict.fromkeys(record_type.ids_in(response)) if each]
    return [record_type.query(each) for each in ids[:_MOST_OF_A_KIND]]


def names(response: Response, query: Query[Any]) -> bool:
    """Return whether `response`, with the right id, names the servo or record of `query`, if there is any."""
    if isinstance(query, QueryServoRequest) and isinstance(response, QueryServoResponse):
        return [servo.servo_id for servo in response.servos] == [query.servo_id]
    return not query.echoed or getattr(response, query.echoed) == getattr(query, query.echoed)
