"""RoundRobin against what it promises: nothing is lost, each program keeps its order, and nobody waits for a flood.

Module: servolink.hub.rules.exchanges.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import given
from hypothesis import strategies as st

from servolink.control import Role
from servolink.hub.rules.exchanges import Exchange, ProgramCounters, ProgramQueue, RoundRobin
from servolink.motion import ServoUnits, StopCounter, Ticket
from servolink.protocol import Codec, Packet, Query, QueryActionRequest, WriteProjectIDRequest


@dataclass(eq=False)
class Asking:
    """A program, as far as its requests are concerned."""

    session_id: str = "s"
    who: str = "a program"
    role: Role = Role.EDIT
    has_left: bool = False
    codec: Codec = field(default_factory=Codec)
    units: ServoUnits = field(default_factory=lambda: ServoUnits("degree"))
    is_subscribed: bool = False
    counters: ProgramCounters = field(default_factory=ProgramCounters)
    queue: ProgramQueue = field(default_factory=ProgramQueue)
    ticket: Ticket | None = None
    servo_stops: int = 0

    def finish(
        self, exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
    ) -> None:
        raise AssertionError

    def finish_with(self, exchange: Exchange, frame: bytes | None) -> None:
        raise AssertionError


TICKET = StopCounter().ticket()


def _always(one: Exchange, other: Exchange) -> bool:
    return True


packets = st.one_of(
    st.integers(0, 3).map(QueryActionRequest),
    st.integers(0, 3).map(WriteProjectIDRequest),
)
queues = st.lists(st.lists(packets, max_size=6), min_size=1, max_size=4)


@given(queues, st.data())
def test_each_request_is_taken_once_and_those_of_a_program_in_its_order(
    asked: list[list[Packet]], data: st.DataObject
) -> None:
    programs, robin = [Asking() for _ in asked], RoundRobin()
    left = [[Exchange(one, packet, TICKET) for packet in wanted] for one, wanted in zip(programs, asked, strict=True)]
    taken: list[list[Exchange]] = [[] for _ in programs]
    to_add = [list(exchanges) for exchanges in left]
    while any(to_add) or robin:
        if any(to_add) and (not robin or data.draw(st.booleans(), "add")):
            source = data.draw(st.sampled_from([exchanges for exchanges in to_add if exchanges]), "of")
            robin.add(source.pop(0))
        elif (exchange := robin.take()) is not None:
            equal = robin.take_equal(exchange, _always) if isinstance(exchange.packet, Query) else []
            assert all(each.packet == exchange.packet for each in equal)
            for each in (exchange, *equal):
                taken[programs.index(each.program)].append(each)  # type: ignore[arg-type]
    for wanted, got in zip(left, taken, strict=True):
        assert sorted(map(id, wanted)) == sorted(map(id, got))
        assert _changes_with_queries_between(wanted) == _changes_with_queries_between(got)


def _changes_with_queries_between(exchanges: list[Exchange]) -> list[object]:
    """Return the changes in order, and which queries stand between two of them."""
    parts: list[object] = []
    queries: set[int] = set()
    for exchange in exchanges:
        if isinstance(exchange.packet, Query):
            queries.add(id(exchange))
        else:
            parts += [queries, id(exchange)]
            queries = set()
    return [*parts, queries]


@given(st.integers(1, 40), st.integers(1, 5))
def test_who_asks_once_waits_for_one_request_of_each_other_program(others: int, flood: int) -> None:
    robin = RoundRobin()
    for _ in range(others):
        program = Asking()
        for number in range(flood):
            robin.add(Exchange(program, QueryActionRequest(number), TICKET))
    for _ in range(others // 2):
        robin.take()
    mine = Exchange(Asking(), QueryActionRequest(-1), TICKET)
    robin.add(mine)
    before = 0
    while robin.take() is not mine:
        before += 1
    assert before <= others


@given(queues, st.data())
def test_while_one_program_holds_the_board_only_its_requests_are_taken(
    asked: list[list[Packet]], data: st.DataObject
) -> None:
    programs, robin = [Asking() for _ in asked], RoundRobin()
    for program, wanted in zip(programs, asked, strict=True):
        for packet in wanted:
            robin.add(Exchange(program, packet, TICKET))
    holder = data.draw(st.sampled_from(programs))
    robin.holder = holder.queue
    mine = len(asked[programs.index(holder)])
    assert bool(robin) == (mine > 0)
    assert sum(1 for _ in iter(robin.take, None)) == mine
    assert not robin
    robin.holder = None
    assert sum(1 for _ in iter(robin.take, None)) == sum(map(len, asked)) - mine


def test_a_blocked_program_is_passed_over() -> None:
    robin, one, other = RoundRobin(), Asking(), Asking()
    first, second = Exchange(one, QueryActionRequest(1), TICKET), Exchange(other, QueryActionRequest(1), TICKET)
    robin.add(first)
    robin.add(second)
    one.queue.blocked_by = second
    assert robin.take() is second
    assert robin.take() is None
    assert not robin
    one.queue.blocked_by = None
    assert robin.take() is first


@given(queues, st.integers(0, 3))
def test_what_is_dropped_is_not_taken_any_more(asked: list[list[Packet]], number: int) -> None:
    robin = RoundRobin()
    for wanted in asked:
        program = Asking()
        for packet in wanted:
            robin.add(Exchange(program, packet, TICKET))
    everything = sum(map(len, asked))
    dropped = robin.drop_where(lambda exchange: exchange.packet == WriteProjectIDRequest(number))
    assert {type(exchange.packet) for exchange in dropped} <= {WriteProjectIDRequest}
    rest = list(iter(robin.take, None))
    assert len(rest) == everything - len(dropped)
    assert all(exchange.packet != WriteProjectIDRequest(number) for exchange in rest)
