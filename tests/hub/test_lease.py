"""The motion lease against a simple model of it, and each of its rules by itself."""

from __future__ import annotations

import math

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from servolink.hub.rules.lease import LeaseChange, MotionLease

programs = st.sampled_from(["ann", "bob", "cid"])
steps = st.sampled_from([0.0, 0.1, 0.35, 1.0, 4.0, 10.0, 30.0])
dead_mans = st.sampled_from([None, None, 0.35, 2.0])


class Leases(RuleBasedStateMachine):
    """The model keeps who holds it and when that ends by time or for want of beats, and nothing else."""

    def __init__(self) -> None:
        super().__init__()
        self.lease = MotionLease()
        self.now = 0.0
        self.holder: str | None = None
        self.dead_man: float | None = None
        self.ends = math.inf
        self.beat_at = 0.0
        self.beats_end = math.inf
        self.barred: set[str] = set()

    def check(self, changes: list[LeaseChange], *expected: LeaseChange) -> None:
        """Compare what was reported with what the model says, the end that was due first."""
        assert changes == [*self.overdue, *expected]

    @property
    def overdue(self) -> list[LeaseChange]:
        return self._overdue

    def begin(self) -> None:
        """End the model's lease if that is due."""
        self._overdue: list[LeaseChange] = []
        if self.holder is not None and self.now >= min(self.ends, self.beats_end):
            is_silent = self.beats_end <= self.ends
            event = "beats stopped" if is_silent else "over"
            self._overdue = [LeaseChange(event, self.holder, None, None, is_silent)]  # type: ignore[arg-type]
            self.free()

    def free(self) -> None:
        self.holder, self.dead_man, self.ends, self.beats_end = None, None, math.inf, math.inf

    def live(self) -> None:
        self.beats_end = math.inf if self.dead_man is None else self.beat_at + self.dead_man

    @rule(seconds=steps)
    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.begin()
        self.check(self.lease.advance(self.now))

    @rule(program=programs, dead_man=dead_mans, force=st.booleans(), is_beat=st.booleans(), late=steps)
    def take(self, program: str, dead_man: float | None, late: float, *, force: bool, is_beat: bool) -> None:
        self.now += late
        self.begin()
        changes = self.lease.take(program, self.now, dead_man=dead_man, force=force, is_beat=is_beat)
        if program in self.barred and not force:
            self.check(changes)
            return
        if not is_beat and any(change.must_stop for change in self.overdue):
            self.check(changes)
            return
        self.barred -= {program}
        if self.holder == program:
            self.dead_man = dead_man or self.dead_man
            self.ends = max(self.ends, self.now + 10.0)
            if is_beat:
                self.beat_at = self.now
            self.live()
            self.check(changes)
        elif self.holder is None or force:
            event = "taken" if self.holder is None else "taken over"
            expected = LeaseChange(event, self.holder, program, program)  # type: ignore[arg-type]
            self.barred |= {self.holder} if self.holder else set()
            self.holder, self.dead_man, self.ends = program, dead_man, self.now + 10.0
            self.beat_at = self.now
            self.live()
            self.check(changes, expected)
        else:
            self.check(changes)

    @rule(program=programs, late=steps)
    def give(self, program: str, late: float) -> None:
        self.now += late
        self.begin()
        expected = [LeaseChange("given back", program, None)] if program == self.holder else []
        if self.holder in {None, program} or program not in self.barred:
            self.barred = set()
        if expected:
            self.free()
        self.check(self.lease.give(program, self.now), *expected)

    @rule(program=programs, late=steps)
    def leave(self, program: str, late: float) -> None:
        self.now += late
        self.begin()
        self.barred -= {program}
        expected = []
        if program == self.holder:
            expected = [LeaseChange("left", program, None, None, self.dead_man is not None)]
            self.free()
        self.check(self.lease.left(program, self.now), *expected)

    @rule(program=programs, late=steps)
    def ask(self, program: str, late: float) -> None:
        self.now += late
        self.begin()
        is_others = self.holder not in {None, program}
        expected = [LeaseChange("asked for", self.holder, self.holder, program)] if is_others else []
        self.check(self.lease.asked(program, self.now), *expected)

    @rule(program=programs, seconds=steps | st.none(), late=steps)
    def move(self, program: str, seconds: float | None, late: float) -> None:
        self.now += late
        self.begin()
        if program == self.holder:
            self.ends = math.inf if seconds is None else max(self.ends, self.now + seconds + 10.0)
        self.check(self.lease.moved(program, None if seconds is None else self.now + seconds, self.now))

    @rule(program=programs, late=steps)
    def beat(self, program: str, late: float) -> None:
        self.now += late
        self.begin()
        if program == self.holder:
            self.beat_at = self.now
            self.live()
        self.check(self.lease.beat(program, self.now))

    @rule(late=steps)
    def stop(self, late: float) -> None:
        self.now += late
        self.begin()
        if self.holder is not None:
            self.ends = self.now + 10.0
        self.check(self.lease.stopped(self.now))

    @invariant()
    def one_holds_it_or_nobody_does(self) -> None:
        assert self.lease.holder == self.holder
        assert [self.lease.is_barred(program) for program in ("ann", "bob", "cid")] == [
            program in self.barred for program in ("ann", "bob", "cid")
        ]
        due = min(self.ends, self.beats_end)
        assert self.lease.next_due() == (None if due == math.inf else due)


TestLeases = Leases.TestCase


def test_the_first_motion_takes_a_free_lease_and_others_are_refused() -> None:
    lease = MotionLease()
    assert lease.take("ann", 1.0) == [LeaseChange("taken", None, "ann", "ann")]
    assert lease.take("bob", 2.0) == []
    assert (lease.holder, lease.since) == ("ann", 1.0)


def test_taking_over_names_both() -> None:
    lease = MotionLease()
    lease.take("ann", 1.0)
    assert lease.take("bob", 2.0, force=True) == [LeaseChange("taken over", "ann", "bob", "bob")]
    assert (lease.holder, lease.since) == ("bob", 2.0)


def test_who_loses_it_does_not_take_it_back_by_moving_on_until_it_is_given_back() -> None:
    lease = MotionLease()
    lease.take("script", 0.0)
    lease.take("somebody", 1.0, force=True)
    lease.left("somebody", 2.0)
    assert lease.take("script", 3.0) == []
    assert (lease.holder, lease.is_barred("script")) == (None, True)
    lease.give("anybody", 4.0)
    assert lease.take("script", 5.0) == [LeaseChange("taken", None, "script", "script")]


def test_it_is_given_back_to_who_lost_it_while_another_program_still_moves() -> None:
    lease = MotionLease(1.0)
    lease.take("script", 0.0)
    lease.take("somebody", 0.5, force=True)
    assert lease.give("script", 0.6) == []
    assert lease.is_barred("script")
    assert lease.give("anybody", 0.7) == []
    assert (lease.holder, lease.is_barred("script")) == ("somebody", False)
    assert lease.take("script", 0.8) == []
    assert lease.advance(1.5) == [LeaseChange("over", "somebody", None)]
    assert lease.take("script", 1.6) == [LeaseChange("taken", None, "script", "script")]


def test_who_loses_it_can_take_it_over_again() -> None:
    lease = MotionLease()
    lease.take("ann", 0.0)
    lease.take("bob", 1.0, force=True)
    assert lease.take("ann", 2.0, force=True) == [LeaseChange("taken over", "bob", "ann", "ann")]
    assert lease.is_barred("bob")


def test_a_lease_ends_10_s_after_the_computed_end_of_the_last_motion() -> None:
    lease = MotionLease()
    lease.take("ann", 0.0)
    lease.moved("ann", 5.0, 0.0)
    lease.moved("ann", 3.0, 1.0)  # shorter, of other servos
    assert lease.next_due() == 15.0
    assert lease.advance(14.999) == []
    assert lease.advance(15.0) == [LeaseChange("over", "ann", None)]


def test_a_motion_of_unknown_end_is_over_when_the_servos_rest() -> None:
    lease = MotionLease()
    lease.take("ann", 0.0)
    lease.moved("ann", None, 0.0)
    assert lease.is_end_unknown
    assert lease.advance(1e9) == []
    assert lease.rested(1e9) == []
    assert lease.next_due() == 1e9 + 10


def test_without_beats_the_board_is_stopped_within_the_dead_man_time() -> None:
    lease = MotionLease()
    lease.take("studio", 0.0, dead_man=0.35)
    lease.moved("studio", 60.0, 0.0)
    for tenth in range(1, 10):
        assert lease.beat("studio", tenth / 10) == []
    assert lease.next_due() == 0.9 + 0.35
    assert lease.advance(0.9 + 0.35) == [LeaseChange("beats stopped", "studio", None, must_stop=True)]


def test_moving_on_is_not_a_beat_and_taking_the_lease_is() -> None:
    lease = MotionLease()
    lease.take("studio", 0.0, dead_man=0.35)
    lease.take("studio", 0.3)
    lease.take("studio", 0.6, is_beat=False)
    assert lease.next_due() == 0.3 + 0.35


def test_a_motion_that_finds_its_program_silent_takes_no_new_lease() -> None:
    lease = MotionLease()
    lease.take("studio", 0.0, dead_man=0.35)
    silent = LeaseChange("beats stopped", "studio", None, must_stop=True)
    assert lease.take("studio", 0.35, is_beat=False) == [silent]
    assert lease.holder is None
    lease.take("studio", 0.4, dead_man=0.35)
    assert [change.event for change in lease.take("studio", 0.75)] == ["beats stopped", "taken"]  # asked for again


def test_silence_counts_before_the_end_of_the_lease() -> None:
    lease = MotionLease(0.5)
    lease.take("studio", 0.0, dead_man=0.5)
    assert lease.advance(0.5) == [LeaseChange("beats stopped", "studio", None, must_stop=True)]


def test_a_late_beat_does_not_bring_the_lease_back() -> None:
    lease = MotionLease()
    lease.take("studio", 0.0, dead_man=0.35)
    assert lease.beat("studio", 0.35) == [LeaseChange("beats stopped", "studio", None, must_stop=True)]
    assert lease.holder is None


def test_a_holder_that_vanishes_stops_the_board_only_with_a_dead_man_time() -> None:
    lease = MotionLease()
    lease.take("studio", 0.0, dead_man=0.35)
    assert lease.left("studio", 0.1) == [LeaseChange("left", "studio", None, must_stop=True)]
    lease.take("script", 1.0)
    assert lease.left("script", 1.1) == [LeaseChange("left", "script", None)]


def test_the_next_holder_is_not_expected_to_beat() -> None:
    lease = MotionLease()
    lease.take("studio", 0.0, dead_man=0.35)
    lease.take("script", 0.1, force=True)
    assert lease.dead_man is None
    assert lease.advance(5.0) == []


@pytest.mark.parametrize("dead_man", [0.0, 0.049, 60.1, math.inf, math.nan, -1.0])
def test_impossible_dead_man_times_are_refused(dead_man: float) -> None:
    with pytest.raises(ValueError, match=r"dead_man must be 0.05..60 s"):
        MotionLease().take("ann", 0.0, dead_man=dead_man)


@pytest.mark.parametrize("seconds", [-1.0, math.inf, math.nan])
def test_impossible_times_of_the_lease_are_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="seconds_after must be finite"):
        MotionLease(seconds)
