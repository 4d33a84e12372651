"""The lease of a hub in time, as a state machine: only the holder moves the board, and stops are in time."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from msgspec import Struct

from servolink.control import LeaseNotice, Role
from servolink.hub.hub import Hub, share
from servolink.hub.rules.lease import LeaseChange, MotionLease
from servolink.protocol import (
    ALL_SERVOS,
    Effect,
    ExecuteActionRequest,
    QueryServoListRequest,
    SetServoParameterRequest,
    Step,
)
from tests.client.piped_board import PipedBoard, opened
from tests.hub.raw_program import RawProgram
from tests.proofs.fuzz.amounts import MANY
from tests.virtual_time import VirtualTimeLoop

# A packet waits some milliseconds for its turn on a busy line, so the hub counts it that much later than the model.
# So everything happens at multiples of 0.1 s, and everything is due halfway between them.
LEASE_SECONDS, DEAD_MAN = 10.05, 0.35

names = st.sampled_from(["ann", "bob", "cid"])
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)


class Leases(RuleBasedStateMachine):
    """Three programs and a watcher. `MotionLease`, which has a test of its own, says who should have the lease."""

    hub: Hub
    watcher: RawProgram
    is_busy: bool

    def __init__(self) -> None:
        super().__init__()
        self.runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        self.stack = AsyncExitStack()
        self.fake = PipedBoard()
        self.model = MotionLease(LEASE_SECONDS)
        self.programs: dict[str, RawProgram] = {}
        self.name_of: dict[str, str] = {}
        self.sent: dict[int, str] = {}
        """By the angle of a movement, which is different for each: who sent it."""
        self.allowed: set[int] = set()
        self.stops_due: list[float] = []
        """When the board has to be stopped at the latest."""
        self.notices: list[Struct] = []

    @initialize(depth=st.sampled_from([1, 4]), is_busy=st.booleans())
    def open(self, depth: int, *, is_busy: bool) -> None:
        async def main() -> None:
            board = await self.stack.enter_async_context(opened(self.fake, angle_unit=None, depth=depth))
            self.hub = await self.stack.enter_async_context(share(board, name="rex", lease_seconds=LEASE_SECONDS))
            self.hub.listen(lambda notice, session: self.notices.append(notice))
            self.watcher = RawProgram(self.hub, "watcher", role=Role.WATCH)

        self.is_busy = is_busy
        self.runner.run(main())

    def program(self, who: str) -> RawProgram:
        async def join() -> RawProgram:
            return RawProgram(self.hub, who)

        if who not in self.programs:
            self.programs[who] = self.runner.run(join())
            self.name_of[self.programs[who].session.session_id] = who
        return self.programs[who]

    def session(self, who: str) -> str:
        return self.program(who).session.session_id

    def pass_time(self, seconds: float) -> None:
        """Let time pass, while a watcher keeps the line busy, and do in the model what is due meanwhile."""

        async def wait() -> None:
            for _ in range(40 if self.is_busy else 0):
                self.watcher.send(QueryServoListRequest())
            await asyncio.sleep(seconds)

        self.runner.run(wait())
        until = self.time + 1e-9  # by so much a loop lets timers fire early
        while (due := self.model.next_due()) is not None and due <= until:
            self.follow(self.model.advance(due), due)

    def follow(self, changes: list[LeaseChange], at: float) -> None:
        """Expect a stop if the lease ended in a way that needs one."""
        self.stops_due += [at + 0.05 for change in changes if change.must_stop]

    @property
    def time(self) -> float:
        return self.runner.get_loop().time()

    @rule(seconds=st.sampled_from([0.1, 0.2, 1.0, 5.0, 12.0]))
    def wait(self, seconds: float) -> None:
        self.pass_time(seconds)

    @rule(who=names, dead_man=st.sampled_from([None, DEAD_MAN]), force=st.booleans())
    def take(self, who: str, dead_man: float | None, *, force: bool) -> None:
        session = self.session(who)
        self.pass_time(0.1)
        self.follow(self.model.take(session, self.time, dead_man=dead_man, force=force), self.time)
        assert self.hub.leases.take(session, dead_man=dead_man, force=force) == (self.model.holder == session)

    @rule(who=names)
    def give(self, who: str) -> None:
        session = self.session(who)
        self.pass_time(0.1)
        self.model.give(session, self.time)
        self.hub.leases.give(session)

    @rule(who=names)
    def beat(self, who: str) -> None:
        session = self.session(who)
        self.pass_time(0.1)
        self.model.beat(session, self.time)
        self.hub.leases.beat(session)

    @rule(who=names, seconds=st.sampled_from([0.1, 1.0, 8.0]))
    def move(self, who: str, seconds: float) -> None:
        session, angle = self.session(who), len(self.sent)
        self.pass_time(0.1)
        self.sent[angle] = who
        self.model.take(session, self.time, is_beat=False)
        if self.model.holder == session:
            self.allowed.add(angle)
            self.model.moved(session, self.time + seconds, self.time)
        self.program(who).send(ExecuteActionRequest((Step(1, angle, round(seconds * 100)),)))
        self.pass_time(0.1)

    @rule(who=names)
    def leave(self, who: str) -> None:
        session = self.session(who)
        self.pass_time(0.1)
        self.follow(self.model.left(session, self.time), self.time)

        async def end() -> None:
            self.programs.pop(who).session.leave()

        self.runner.run(end())
        self.pass_time(0.1)

    @rule()
    def stop(self) -> None:
        self.pass_time(0.1)
        self.model.stopped(self.time)
        self.stops_due.append(self.time)

        async def ask() -> None:
            self.watcher.send(STOP)

        self.runner.run(ask())
        self.pass_time(0.3)

    @invariant()
    def only_the_holder_moves(self) -> None:
        if not hasattr(self, "hub"):
            return
        arrived = [packet for _, packet in self.fake.executed if packet.is_motion]
        angles = [packet.steps[0].degree for packet in arrived if isinstance(packet, ExecuteActionRequest)]
        assert angles == sorted(set(angles))
        assert set(angles) <= self.allowed
        lease = self.hub.lease
        assert (None if lease is None else lease.session) == self.model.holder

    @invariant()
    def the_board_is_stopped_in_time(self) -> None:
        stops = [at for at, packet in self.fake.sent if packet.effect is Effect.STOPS]
        for due in self.stops_due:
            if self.time >= due:
                assert any(due - 0.051 <= at <= due + 1e-9 for at in stops), (due, stops)
        for at in stops:
            assert any(due - 0.051 <= at for due in self.stops_due)

    def teardown(self) -> None:
        with self.runner:
            if hasattr(self, "hub"):
                self.pass_time(1)
                self.only_the_holder_moves()
                self.the_board_is_stopped_in_time()
                changes = [notice.event for notice in self.notices if isinstance(notice, LeaseNotice)]
                taken = changes.count("taken")
                ended = sum(changes.count(event) for event in ("given back", "left", "over", "beats stopped"))
                assert taken - ended == (self.hub.lease is not None)
                self.runner.run(self.stack.aclose())


TestLeases = Leases.TestCase
TestLeases.settings = settings(max_examples=15 * MANY, stateful_step_count=30, deadline=None)


def test_the_machine_uses_the_time_of_its_loop() -> None:
    machine = Leases()
    machine.open(depth=1, is_busy=True)
    machine.take("ann", DEAD_MAN, force=False)
    machine.move("ann", 8.0)
    machine.wait(1.0)
    machine.the_board_is_stopped_in_time()
    assert machine.hub.lease is None
    assert len(machine.stops_due) == 1
    machine.teardown()
