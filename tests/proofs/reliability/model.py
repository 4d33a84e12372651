"""All that can happen to a few requests: every order of sendings, losses, delays, repeats, cancels, fences and stops.

A perfect oracle stands for the board. It responds in order and at most once, or twice where a case says so, and every
response says which sending it answers. Any of them may be lost, request or response, or come as late as it likes. In
each state that `Slots` can be in, everything that may happen next is tried; after each step must hold:

* what a caller gets answers its question, and was asked for after its first sending; a command's result belongs to
  its one sending;
* a slot is over once, and only if its response cannot come any more;
* every response that comes has a slot which it may answer, and every unmatched response belongs to an open slot;
* nothing is open beside a packet that must be alone;
* the response to one more fence settles everything.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Iterator
from copy import copy as copy_of
from dataclasses import dataclass, field
from typing import Any

from benchmarks.measuring import Result, table
from servolink.connection import Obstacle, RepeatingSlots, Slot, Slots
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    ExecuteMacroRequest,
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoRequest,
    Request,
    Response,
    SetServoParameterRequest,
    WriteProjectIDRequest,
)
from tests.client.numbered_board import numbered
from tests.connection import opening_states as openings

T = QueryServoRequest(ALL_SERVOS)
A, B = QueryActionRequest(1), QueryActionRequest(2)
C, D, E = AddActionRequest(1), AddActionRequest(2), AddActionRequest(3)
P, W = QueryProjectIDRequest(), WriteProjectIDRequest(1)
M, S = ExecuteMacroRequest(1), SetServoParameterRequest(1, 1, 1)
ONE, SERVOS = QueryServoRequest(3), QueryServoListRequest()
POWER, STOP = QueryRemainPowerRequest(), SetServoParameterRequest(ALL_SERVOS, 0, 1)

_FENCE, _STOP = -1, -2
_WAITING, _OVER = "waiting", "over"


@dataclass(frozen=True, slots=True)
class Case:
    """What happens: the requests, begun in this order, and at most so many of each other thing."""

    name: str
    requests: tuple[Request[Any], ...]
    repeats: int = 0
    cancels: int = 0
    fences: int = 0
    stops: int = 0
    fence: Request[Any] = POWER
    copies: int = 1
    """How often each sending is answered, at most."""


SHORT = (
    Case("equal queries", (T, T), repeats=1, cancels=1, fences=1),
    Case("keyed queries", (A, B), repeats=1, cancels=1, fences=1),
    Case("keyed queries, two of them equal", (A, A, B), repeats=1),
    Case("commands without read-back", (C, D), cancels=1, fences=2),
    Case("command, read-back and telemetry", (C, T, A), repeats=1),
    Case("a fence that is asked for as well", (P, T, P), fences=1, fence=P),
    Case("a setting and a fence", (W, P, W), repeats=1, fences=1),
    Case("stop", (S, T), fences=1, stops=2),
    Case("alone", (T, M, T), fences=1),
    Case("one servo, fenced by all of them", (ONE, SERVOS, ONE), repeats=1, fences=1, fence=T),
    Case("equal queries, answered twice", (T, T), repeats=2, cancels=1, fences=2, copies=2),
    Case("keyed queries, answered twice", (A, B), repeats=1, cancels=1, fences=2, copies=2),
    Case("commands, answered twice", (C, D), cancels=1, fences=2, copies=2),
    Case("a fence that is asked for, answered twice", (P, T, P), fences=2, fence=P, copies=2),
    Case("a setting, answered twice", (W, P), repeats=1, fences=2, copies=2),
    Case("stop, answered twice", (S, T), fences=1, stops=1, copies=2),
    Case("alone, answered twice", (T, M), fences=1, copies=2),
)
LONG = (
    Case("equal queries", (T, T, T), repeats=1, cancels=1, fences=1),
    Case("keyed queries", (A, B, A), repeats=1, cancels=1, fences=1),
    Case("keyed queries, two of them equal", (A, A, B, B), repeats=1, cancels=1),
    Case("commands without read-back", (C, D, E), cancels=1, fences=2),
    Case("command, read-back and telemetry", (C, D, A, T), repeats=1, fences=1),
    Case("two records, read back", (C, A, D, B), repeats=1, fences=1),
    Case("a fence that is asked for as well", (P, T, P), repeats=1, fences=2, fence=P),
    Case("a setting and a fence", (W, P, W), repeats=2, cancels=1, fences=1),
    Case("stop", (S, T, S, T), fences=1, stops=2),
    Case("alone", (T, M, T, M), repeats=1, fences=2),
    Case("equal queries, answered twice", (T, T, T), repeats=2, cancels=1, fences=3, copies=2),
    Case("keyed queries, answered twice", (A, B, A), repeats=1, fences=3, copies=2),
    Case("command, read-back and telemetry, answered twice", (C, A, T), repeats=1, fences=2, copies=2),
    Case("stop, answered twice", (S, T, S), fences=1, stops=2, copies=2),
)


class Violation(AssertionError):
    """What must not be."""


@dataclass(slots=True)
class State:
    """One state of the conversation."""

    slots: Slots
    sent: list[tuple[int, Request[Any]]] = field(default_factory=list)
    """Whose and what each sending was."""
    coming: tuple[int, ...] = ()
    """Sendings whose response may still come, in order."""
    callers: list[str] = field(default_factory=list)
    first: list[int] = field(default_factory=list)
    """The first sending of each caller."""
    left: dict[str, int] = field(default_factory=dict)
    """How often other things may still happen."""
    trace: tuple[str, ...] = ()

    def copy(self, event: str) -> State:
        """Return the same state, to be changed by `event`."""
        return State(
            _copy(self.slots),
            self.sent.copy(),
            self.coming,
            self.callers.copy(),
            self.first.copy(),
            self.left.copy(),
            (*self.trace, event),
        )

    def key(self) -> object:
        """Return what tells this state from others."""
        lanes = [lane for lane in self.slots.lanes.values() if lane.slots]
        return (
            tuple(self.sent),
            self.coming,
            tuple(self.callers),
            tuple(self.left.values()),
            tuple((slot.sent_at, slot.overdue, slot.answered) for lane in lanes for slot in lane.slots),
            tuple((lane.response_id, lane.stopped, tuple(lane.unmatched)) for lane in lanes),
        )


class Model:
    """Goes through all states of a case, with `rules` in place of `Slots`."""

    def __init__(self, case: Case, rules: type[Slots] | None = None) -> None:
        """Begin with nothing sent."""
        rules = rules or (Slots if case.copies == 1 else RepeatingSlots)
        self.states = 0
        self.steps = 0
        self._case = case
        self._seen: set[object] = set()
        slots = rules()
        used = {request.packet_id + 1 for request in (*case.requests, case.fence, POWER, STOP)}
        slots.lanes = {response_id: lane for response_id, lane in slots.lanes.items() if response_id in used}
        left = {"repeat": case.repeats, "cancel": case.cancels, "fence": case.fences, "stop": case.stops}
        self._begin = State(slots, left=left)

    def run(self) -> None:
        """Visit all states. Raise Violation, with the trace that leads to it, if a rule is broken."""
        waiting = deque([self._begin])  # in order of length, so that the shortest trace is found
        while waiting:
            state = waiting.popleft()
            for following in self._steps(state):
                self.steps += 1
                if (key := following.key()) not in self._seen:
                    self._seen.add(key)
                    waiting.append(following)
        self.states = len(self._seen) + 1

    def _steps(self, state: State) -> Iterator[State]:
        yield from self._begin_next(state)
        yield from self._deliver(state)
        live = [slot for lane in state.slots.lanes.values() for slot in lane.slots if not _is_over(slot)]
        for slot in live:
            after = state.copy(f"#{slot.sent_at:g} overdue")
            after.slots.expire(_twin(slot, after))
            yield after
        for caller, how in enumerate(state.callers):
            if how == _WAITING:
                yield from self._go_on(state, caller)
        if state.left["fence"]:
            after = self._spend(state, "fence")
            self._send(after, _FENCE, self._case.fence)
            yield after
        if state.left["stop"]:
            after = self._spend(state, "stop")
            self._send(after, _STOP, STOP)
            for slot in list(after.slots.lanes[STOP.packet_id + 1].slots):  # callers on the lane are told at once
                self._end(after, after.sent[int(slot.sent_at)][0])
            yield after

    def _begin_next(self, state: State) -> Iterator[State]:
        caller = len(state.callers)
        if caller == len(self._case.requests):
            return
        request = self._case.requests[caller]
        obstacle = state.slots.obstacle(request)
        if obstacle in {Obstacle.WAIT, Obstacle.FENCE}:
            return
        after = state.copy(f"begin {caller}")
        if obstacle is Obstacle.FENCE_BESIDE:
            self._send(after, _FENCE, self._case.fence if self._case.fence != request else POWER)
        lanes = after.slots.lanes.values()
        open_slots = [slot for lane in lanes for slot in lane.slots if not slot.answered]
        if open_slots and (request.exclusive or any(_is_exclusive(slot, after) for slot in open_slots)):
            raise Violation(_told(after, f"{request} beside others"))
        after.callers.append(_WAITING)
        after.first.append(len(after.sent))
        self._send(after, caller, request)
        yield after

    def _go_on(self, state: State, caller: int) -> Iterator[State]:
        """A caller loses patience, or asks again once nothing of what it sent is under way."""
        if state.left["cancel"]:
            after = self._spend(state, "cancel", f" {caller}")
            after.callers[caller] = _OVER
            yield after
        request = self._case.requests[caller]
        lane = state.slots.lanes[request.packet_id + 1]
        under_way = any(not _is_over(slot) and state.sent[int(slot.sent_at)][0] == caller for slot in lane.slots)
        must_wait = state.slots.answer_twice and lane.slots
        if state.left["repeat"] and request.repeatable and not under_way and not must_wait:
            after = self._spend(state, "repeat", f" {caller}")
            self._send(after, caller, request)
            yield after

    def _spend(self, state: State, what: str, whose: str = "") -> State:
        after = state.copy(what + whose)
        after.left[what] -= 1
        return after

    def _send(self, state: State, owner: int, request: Request[Any]) -> None:
        number = len(state.sent)
        state.sent.append((owner, request))
        state.coming = (*state.coming, *[number] * self._case.copies)
        slot = Slot(request, state.slots.lanes[request.packet_id + 1], None, number)
        if owner == _STOP:
            state.slots.open_stop(slot)
        else:
            state.slots.open(slot)

    def _deliver(self, state: State) -> Iterator[State]:
        """Any response may be the next one that comes; those before it are lost."""
        for at, number in enumerate(state.coming):
            request = state.sent[number][1]
            for content in _responses(request, number):
                after = state.copy(f"{content} to #{number}")
                after.coming = state.coming[at + 1 :]
                self._settle(after, content)
                yield after

    def _settle(self, state: State, content: Response) -> None:
        settled = state.slots.settle(content.packet_id, content)
        if settled is None:
            raise Violation(_told(state, "no slot can be its origin"))
        for slot, got in settled:
            number = int(slot.sent_at)
            caller = state.sent[number][0]
            if slot.open or (number in state.coming and (got is None or self._case.copies == 1)):
                raise Violation(_told(state, f"#{number} is said to be over, but is not"))
            if caller < 0 or state.callers[caller] == _OVER:
                continue
            if got is not None:
                assert isinstance(got, Response)  # the oracle sends nothing that is unreadable
                self._judge(state, caller, number, got)
                self._end(state, caller)
            elif not slot.request.repeatable:
                self._end(state, caller)  # its outcome is unknown
        self._check(state)

    def _judge(self, state: State, caller: int, number: int, got: Response) -> None:
        request = self._case.requests[caller]
        first = state.first[caller]
        origins = range(first, len(state.sent)) if request.repeatable else [number]
        if not any(state.sent[origin][1] == request and got in _responses(request, origin) for origin in origins):
            raise Violation(_told(state, f"caller {caller} got {got}"))

    def _end(self, state: State, caller: int) -> None:
        if caller >= 0:
            state.callers[caller] = _OVER

    def _check(self, state: State) -> None:
        unmatched, known = 0, set[int]()
        for lane in state.slots.lanes.values():
            numbers = [int(slot.sent_at) for slot in lane.slots]
            known.update(numbers)
            unmatched += len(lane.unmatched)
            for content in lane.unmatched:
                if not any(content in _responses(state.sent[number][1], number) for number in numbers):
                    raise Violation(_told(state, f"{content} is unmatched, but belongs to no open slot"))
        if lost := set(state.coming) - known:
            raise Violation(_told(state, f"{lost} may still be answered, but are not open"))
        if unmatched != state.slots.unmatched:
            raise Violation(_told(state, f"{unmatched} responses are unmatched, not {state.slots.unmatched}"))
        self._check_fence(state.copy("one more fence is answered"))

    def _check_fence(self, state: State) -> None:
        state.coming = ()
        for lane in state.slots.lanes.values():
            if lane.response_id == self._case.fence.packet_id + 1 and lane.slots:
                return  # not on an idle lane
        self._send(state, _FENCE, self._case.fence)
        state.slots.settle(self._case.fence.packet_id + 1, numbered(self._case.fence, len(state.sent) - 1))
        still_open = [slot for lane in state.slots.lanes.values() for slot in lane.slots]
        if state.slots.unmatched or len(still_open) > state.slots.answer_twice:
            raise Violation(_told(state, "something is still open"))


def _responses(request: Request[Any], number: int) -> tuple[Response, ...]:
    """Return what a board may say to a sending: of a record also that there is none."""
    number += 1  # no result is 0, and of no eighth record there is none
    if isinstance(request, QueryActionRequest):
        caption = str(number)
        return QueryActionResponse(request.action_id, caption), QueryActionResponse(0, caption)
    return (numbered(request, number),)


def _is_over(slot: Slot) -> bool:
    """Return whether nothing waits for a slot: it is overdue, or what is left of an answered one."""
    return slot.overdue or slot.answered


def _is_exclusive(slot: Slot, state: State) -> bool:
    return slot.request.exclusive and state.sent[int(slot.sent_at)][0] != _STOP


def _told(state: State, what: str) -> str:
    sent = ", ".join(f"#{number} {type(request).__name__}" for number, (_, request) in enumerate(state.sent))
    return "\n  ".join((what, sent, *state.trace))


def _twin(slot: Slot, state: State) -> Slot:
    lane = state.slots.lanes[slot.request.packet_id + 1]
    return next(each for each in lane.slots if each.sent_at == slot.sent_at)


def _copy(slots: Slots) -> Slots:
    """Return a copy that shares nothing with `slots`."""
    copy = object.__new__(type(slots))
    vars(copy).update(vars(slots))
    twins: dict[int, Slot] = {}
    copy.lanes = {}
    for response_id, lane in slots.lanes.items():
        copy.lanes[response_id] = one = copy_of(lane)
        one.slots, one.unmatched = deque(), lane.unmatched.copy()

    def twin(slot: Slot) -> Slot:
        if (known := twins.get(id(slot))) is None:
            lane = copy.lanes[slot.lane.response_id]
            known = Slot(slot.request, lane, None, slot.sent_at, open=slot.open)
            known.overdue, known.answered = slot.overdue, slot.answered
            twins[id(slot)] = known
        return known

    for response_id, lane in slots.lanes.items():
        copy.lanes[response_id].slots.extend(twin(slot) for slot in lane.slots)
    copy.live = deque(twin(slot) for slot in slots.live)
    copy._order = deque(twin(slot) for slot in slots._order)
    copy._exclusive = None if slots._exclusive is None else twin(slots._exclusive)
    return copy


def run(*, short: bool) -> Result:
    """Check all cases."""
    rows: list[tuple[object, ...]] = []
    wrong = []
    figures = {}
    for case in SHORT if short else LONG:
        model = Model(case)
        begun = time.monotonic()
        try:
            model.run()
        except Violation as violation:
            wrong.append(f"{case.name}: {violation}")
        figures[case.name] = {"states": model.states, "steps": model.steps}
        others = {"repeats": case.repeats, "cancels": case.cancels, "fences": case.fences, "stops": case.stops}
        rows.append(
            (
                case.name,
                len(case.requests),
                ", ".join(f"{count} {name}" for name, count in others.items() if count),
                f"{model.states:,}",
                f"{model.steps:,}",
            )
        )
        sys.stderr.write(f"{case.name}: {model.states:,} states in {time.monotonic() - begun:.0f} s\n")
    for opening in openings.SHORT:
        states, faults = openings.walk(opening)
        wrong += faults[:3]
        figures[f"opening: {opening.name}"] = {"states": states}
        rows.append((f"opening: {opening.name}", opening.kinds, f"{opening.owed} owed", f"{states:,}", ""))
        sys.stderr.write(f"opening, {opening.name}: {states:,} states\n")
    quote = table(
        "all interleavings, losses and delays of a few requests",
        ("requests", "number", "beside them", "states", "steps"),
        rows,
        notes=[
            "checked in each state: no wrong response, no stale one, no slot given up whose response can still come"
        ],
    )
    return {"tables": [quote], "wrong": wrong, "figures": figures}
