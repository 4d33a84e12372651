"""Exchanges: requests of all programs, and the order of sending to the board."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from itertools import islice
from typing import NamedTuple, Protocol

from msgspec import Struct

from servolink.control import Role
from servolink.errors import ServolinkError
from servolink.hub.rules.courses import Play
from servolink.motion import MotionPlan, MotionPlanner, Movement, ServoUnits, SetPoints, Ticket
from servolink.protocol import Codec, Packet, Query

_MOST_EQUAL = 16  # queries of a program that are answered together: a response can have 64 KiB
_FARTHEST_EQUAL = 64  # requests of a program that are searched for equal queries at each sending


class ProgramCounters(Struct):
    """Counters of the traffic between a program and the hub."""

    requests: int = 0
    """Frames of the program, of whatever kind."""
    responses: int = 0
    """Frames sent to the program, button events included."""
    unanswered: int = 0
    """Requests that the board did not answer."""
    refused: int = 0
    """Requests that were not sent: without the role or the lease, beyond a limit, or after a stop."""
    ignored: int = 0
    """Intact frames that no board would answer: of a board, undecodable, or in mode 0."""


class HeardStops:
    """Stops of all servos that a program was told of, and those that it has acknowledged on one of its connections.

    What a program sent before it heard of the stop of another one arrives after that stop, and is still of before it.
    """

    told = 0
    """Number of the latest stop that the program was told of."""
    heard: int | None = None
    """Number of the latest stop that the program has acknowledged; None for a program that acknowledges none."""

    @property
    def is_behind(self) -> bool:
        """Whether what arrives now may be of before a stop."""
        return self.heard is not None and self.heard < self.told


class Asker(Protocol):
    """Program that sends requests, as seen by the senders of responses."""

    session_id: str
    who: str
    role: Role
    units: ServoUnits
    is_subscribed: bool
    counters: ProgramCounters
    codec: Codec
    queue: ProgramQueue
    has_left: bool

    def finish(
        self, exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
    ) -> None:
        """Finish a request with a response, or with None; `content` is the response in the encoding of `codec`."""


class RunEnd(NamedTuple):
    """End of a run of an action or a macro."""

    seconds: float
    """Duration in seconds."""
    pose: Mapping[int, int]
    """Last target of each servo, by id."""
    play: Play | None = None
    """The steps of the run; None for a movement."""


class MoveOrder(Struct, frozen=True):
    """Movement of a program, to be planned when it is sent."""

    movement: Movement
    planner: MotionPlanner
    """Planner with the limits of board and program."""
    start: bool = False
    """Whether to start and hold servos first that are stopped or released."""
    must_stand: bool = False
    """Whether a forecast must be certain that the robot stands; no person is asked."""


class Exchange(Struct, eq=False):
    """Request of a program until the response, the sending (without a response) or the failure."""

    program: Asker
    packet: Packet
    ticket: Ticket
    """Ticket of the request; a motion is not sent after a later stop."""
    asked_at: float = 0.0
    """Time of arrival, on the clock of the event loop."""
    size: int = 0
    """Bytes that count as held until the request is finished."""
    end: RunEnd | None = None
    """End of the motion, if known in advance."""
    points: SetPoints | None = None
    """Limiter of a set-point of a stream, which is shortened and not refused; None for any other request."""
    order: MoveOrder | None = None
    """Movement to plan, in place of a packet that is sent as it is; None for any other request."""
    plan: MotionPlan | None = None
    """Plan of `order` that was sent."""
    is_unchecked: bool = True
    """Whether values that only a board sends are allowed, as in frames."""
    refused: str = ""
    """Reason for not sending the request; empty if sent or still queued."""
    error: ServolinkError | None = None
    """Error in place of a response: refused, or not answered."""
    frame: bytes | None = None
    """Frame of the response; None without one."""
    is_unsent: bool = False
    """Whether the board has certainly not got the request, as the hub had lost the board before."""
    has_begun: bool = False
    """Whether a soft start has begun, during which the units of the program are kept."""
    may_wait: bool = True
    """Whether the request may wait for more than the line, such as other angle units."""
    is_silent: bool = False
    """Whether the response is withheld from the program."""
    is_over: bool = False
    equal: tuple[Exchange, ...] | list[Exchange] = ()
    """Equal queries, finished with the same response."""

    @property
    def is_wanted(self) -> bool:
        """Whether a program still waits for the response: the sender, or the sender of an equal query."""
        return not all(each.program.has_left for each in (self, *self.equal))


class ProgramQueue:
    """Unsent requests of a program, in order."""

    __slots__ = ("blocked_by", "exchanges", "is_listed", "is_unread")

    def __init__(self) -> None:
        self.exchanges: deque[Exchange] = deque()
        self.blocked_by: Exchange | None = None
        """Request being sent, which later requests must not overtake; None without one."""
        self.is_unread = False
        """Whether the program leaves responses unread, so that requests are held back."""
        self.is_listed = False
        """Whether the queue is in the ring of a `RoundRobin`."""


class RoundRobin:
    """Queues of all programs, served in turn, a request from each.

    A program that floods waits in its own queue. Nothing here is asynchronous: whoever sends asks for the next one.
    """

    def __init__(self) -> None:
        self.ring: deque[ProgramQueue] = deque()
        """Queues with unsent requests; the next first."""
        self.holder: ProgramQueue | None = None
        """Program with exclusive use, whose requests alone are taken; None without one."""

    def __bool__(self) -> bool:
        """Return whether there is a request to send."""
        return any(self._may_take(queue) for queue in self.ring)

    def add(self, exchange: Exchange) -> None:
        """Append a request to the program's queue."""
        queue = exchange.program.queue
        queue.exchanges.append(exchange)
        if not queue.is_listed:
            queue.is_listed = True
            self.ring.append(queue)

    def take(self) -> Exchange | None:
        """Return the next request to send, and move the program to the end of the ring; None without one."""
        ring = self.ring
        for _ in range(len(ring)):
            queue = ring[0]
            if self._may_take(queue):
                exchange = queue.exchanges.popleft()
                ring.popleft()
                queue.is_listed = bool(queue.exchanges)
                if queue.is_listed:
                    ring.append(queue)
                return exchange
            ring.rotate(-1)
        return None

    def take_equal(self, taken: Exchange, means_same: Callable[[Exchange, Exchange], bool]) -> list[Exchange]:
        """Return the unsent queries that the response to the query `taken` answers as well.

        That is an equal query for which `means_same`, if it is the next request of its program; in the program of
        `taken` itself, if there are only queries before it. Others may depend on what is sent before them.
        """
        packet, equal = taken.packet, list[Exchange]()
        for queue in self.ring:
            if not self._may_take(queue):
                continue
            waiting, is_own = queue.exchanges, queue is taken.program.queue
            room = _MOST_EQUAL - is_own
            while room and waiting and waiting[0].packet == packet and means_same(taken, waiting[0]):
                equal.append(waiting.popleft())
                room -= 1
            if is_own:
                equal += self._take_later(queue, packet, room)
        if equal:
            self._drop_empty()
        return equal

    def drop(self, queue: ProgramQueue) -> list[Exchange]:
        """Remove and return all requests of a program."""
        dropped = list(queue.exchanges)
        queue.exchanges.clear()
        if self.holder is queue:
            self.holder = None
        self._drop_empty()
        return dropped

    def drop_where(self, unwanted: Callable[[Exchange], bool]) -> list[Exchange]:
        """Remove the requests of all programs that are `unwanted` and return the removed requests."""
        dropped = list[Exchange]()
        for queue in self.ring:
            found = [exchange for exchange in queue.exchanges if unwanted(exchange)]
            if found:
                queue.exchanges = deque(exchange for exchange in queue.exchanges if not unwanted(exchange))
                dropped += found
        self._drop_empty()
        return dropped

    def _may_take(self, queue: ProgramQueue) -> bool:
        if queue.blocked_by is not None or queue.is_unread:
            return False
        return self.holder is None or queue is self.holder

    def _take_later(self, queue: ProgramQueue, packet: Packet, most: int) -> list[Exchange]:
        """Return the first queries equal to `packet` that stand behind other queries of the same program."""
        queries = list[Exchange]()
        for exchange in islice(queue.exchanges, _FARTHEST_EQUAL):
            if not isinstance(exchange.packet, Query) or len(queries) == most:
                break
            if exchange.packet == packet:
                queries.append(exchange)
        for exchange in queries:
            queue.exchanges.remove(exchange)
        return queries

    def _drop_empty(self) -> None:
        for queue in self.ring:
            queue.is_listed = bool(queue.exchanges)
        self.ring = deque(queue for queue in self.ring if queue.is_listed)
