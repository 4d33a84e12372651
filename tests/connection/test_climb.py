"""DepthClimb: the smallest depth that fills the line, found on models of lines."""

from __future__ import annotations

import heapq
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from random import Random

import pytest

from servolink.connection.climb import FIRST_WAIT, LEAST_RESPONSES, LONGEST_WAIT, DepthClimb

TRY = 0.25
"""Seconds after which a response counts as lost."""


@dataclass
class Line:
    """A board behind a line that a program keeps as full as it may; one response takes 1 ms of it."""

    climb: DepthClimb
    latency: float = 0.0
    """Seconds from a request until its response begins, if the board has nothing else to do."""
    loss: float = 0.0
    """The share of responses that are lost."""
    room: int = 64
    """How many requests the board keeps; what comes beside them is lost."""
    now: float = 0.0
    random: Random = field(default_factory=lambda: Random(7))
    since: float = 0.0
    answered: int = 0
    at_depth: Counter[int] = field(default_factory=Counter)
    """Responses by depth."""
    depths: list[int] = field(default_factory=list)
    """The depth after each response."""
    _free_at: float = 0.0
    _under_way: list[tuple[float, bool]] = field(default_factory=list)

    def run(self, responses: int) -> Line:
        for _ in range(responses):
            self._answer()
        return self

    @property
    def share(self) -> float:
        """The share of the line that was used."""
        return self.answered * 0.001 / (self.now - self.since)

    def forget(self) -> None:
        """Count from now on."""
        self.since, self.answered = self.now, 0
        self.at_depth.clear()

    def _answer(self) -> None:
        while True:
            while len(self._under_way) < self.climb.depth:
                self._send()
            self.now, comes = heapq.heappop(self._under_way)
            if comes:
                break
            self.climb.lost()
        self.answered += 1
        self.at_depth[self.climb.depth] += 1
        self.climb.answered(self.now, full=True, has_backlog=True)
        self.depths.append(self.climb.depth)

    def _send(self) -> None:
        if sum(comes for _, comes in self._under_way) >= self.room or self.random.random() < self.loss:
            heapq.heappush(self._under_way, (self.now + TRY, False))
            return
        self._free_at = max(self._free_at, self.now + self.latency) + 0.001
        heapq.heappush(self._under_way, (self._free_at, True))


def usual(line: Line) -> int:
    """Return the depth at which most responses came."""
    return line.at_depth.most_common(1)[0][0]


# --- a line that stays as it is -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("latency", "depth", "share"),
    [(0.0, 1, 1.0), (0.00006, 2, 0.99), (0.0005, 2, 0.99), (0.001, 2, 0.99), (0.002, 4, 0.99), (0.01, 16, 0.98)],
)
def test_it_ends_at_the_smallest_depth_that_fills_a_clean_line(latency: float, depth: int, share: float) -> None:
    line = Line(DepthClimb(16), latency).run(2_000)
    line.forget()
    assert usual(line.run(10_000)) == depth
    assert line.share >= share


def test_a_line_that_only_waits_gets_all_that_is_allowed() -> None:
    line = Line(DepthClimb(6), 0.1).run(5_000)
    assert (usual(line), max(line.depths)) == (6, 6)


@pytest.mark.parametrize("latency", [0.001, 0.007, 0.03])
def test_losses_that_do_not_depend_on_the_depth_keep_it_from_nothing(latency: float) -> None:
    line, shallow = Line(DepthClimb(64), latency, 0.05), Line(DepthClimb(1), latency, 0.05)
    line.run(20_000).forget()
    assert line.run(20_000).share > 0.8
    assert line.share > 5 * shallow.run(2_000).share


def test_with_a_bound_of_1_nothing_is_tried() -> None:
    assert set(Line(DepthClimb(1), 0.1, 0.05).run(2_000).depths) == {1}


# --- boards that do not queue -------------------------------------------------------------------------------------


def test_a_board_that_queues_nothing_is_left_in_peace() -> None:
    line = Line(DepthClimb(16), 0.002, room=1).run(20_000)
    assert line.at_depth[1] > 0.98 * line.answered


@pytest.mark.parametrize("loss", [0.0, 0.01, 0.05])
def test_a_board_that_queues_nothing_answers_no_less_than_at_depth_1(loss: float) -> None:
    line, exclusive = (Line(DepthClimb(bound), 0.002, loss, room=1).run(20_000) for bound in (16, 1))
    assert line.share > 0.95 * exclusive.share


def test_a_board_that_queues_four_gets_four() -> None:
    line = Line(DepthClimb(64), 0.05, room=4).run(20_000)
    assert usual(line) == 4
    assert line.at_depth[4] > 0.95 * line.answered


def test_a_trial_is_over_after_few_losses_also_if_the_window_is_never_full() -> None:
    climb = DepthClimb(4)
    Line(climb, 0.002).run(LEAST_RESPONSES + 1)
    assert climb.depth == 2
    for _ in range(2):
        climb.answered(1.0, full=False, has_backlog=False)
    for _ in range(4):
        assert climb.depth == 2
        climb.lost()
    assert climb.depth == 1


def test_a_depth_that_loses_more_is_not_kept_though_it_is_faster() -> None:
    climb = DepthClimb(2)
    now = 0.0
    for seconds, times, lose in ((0.002, LEAST_RESPONSES + 1, 0), (0.001, 2 + 16 * LEAST_RESPONSES, 10)):
        for number in range(times):
            if lose and number % lose == 2:
                climb.lost()
            now += seconds
            climb.answered(now, full=True, has_backlog=True)
            if number == times // 2:
                assert climb.depth == 1 + bool(lose)
    assert climb.depth == 1


# --- when something is tried --------------------------------------------------------------------------------------


def test_what_did_not_pay_is_tried_again_after_longer_and_longer_pauses() -> None:
    climb = DepthClimb(2)
    line = Line(climb).run(40_000)
    trials = [at for at, (before, after) in enumerate(pairwise(line.depths)) if before < after]
    ends = [at for at, (before, after) in enumerate(pairwise(line.depths)) if before > after]
    pauses = [(trial - end) // LEAST_RESPONSES for end, trial in zip(ends, trials[1:], strict=False)]
    waits = [FIRST_WAIT * 2**n for n in range(6)]
    assert waits[-1] == LONGEST_WAIT
    assert pauses == [wait + 1 for wait in [*waits, LONGEST_WAIT, LONGEST_WAIT]][: len(pauses)]
    assert len(pauses) > 6


def test_nothing_is_tried_as_long_as_nobody_wants_more() -> None:
    climb = DepthClimb(16)
    for number in range(1000):
        climb.answered(number * 0.01, full=True, has_backlog=False)
    assert climb.depth == 1


def test_a_pause_in_which_the_window_was_not_full_is_not_measured() -> None:
    climb = DepthClimb(2)
    now = 0.0

    def answer(times: int, seconds: float, *, full: bool = True) -> None:
        nonlocal now
        for _ in range(times):
            now += seconds
            climb.answered(now, full=full, has_backlog=True)

    answer(LEAST_RESPONSES + 1, 0.010)
    assert climb.depth == 2
    for _ in range(LEAST_RESPONSES):  # each time twice as fast, then nothing for a second
        answer(1, 1.0, full=False)
        answer(2, 0.005)
    answer(200, 0.005)
    assert climb.depth == 2


# --- a line that changes ------------------------------------------------------------------------------------------


def test_a_line_that_gets_slower_to_answer_gets_more_and_gives_it_back_when_the_board_no_longer_queues() -> None:
    line = Line(DepthClimb(16), 0.0001).run(2_000)
    assert line.climb.depth == 2
    line.latency = 0.012
    line.run(20_000).forget()
    assert usual(line.run(2_000)) == 16
    line.room = 1
    line.run(2_000).forget()
    assert usual(line.run(10_000)) <= 2


def test_a_depth_that_still_pays_is_kept_when_the_line_gets_worse_for_all() -> None:
    line = Line(DepthClimb(8), 0.006).run(2_000)
    assert line.climb.depth == 8
    line.loss = 0.1
    line.run(20_000).forget()
    assert usual(line.run(20_000)) == 8


def test_responses_of_one_chunk_count_as_they_do_one_by_one() -> None:
    together, one_by_one = DepthClimb(2), DepthClimb(2)

    def answer(now: float, responses: int) -> tuple[int, int]:
        together.answered(now, responses, full=True, has_backlog=True)
        for _ in range(responses):
            one_by_one.answered(now, full=True, has_backlog=True)
        return together.depth, one_by_one.depth

    assert answer(0.0, 1) == (1, 1)  # from which the time counts
    depths = [answer(0.01 * number, 4) for number in range(1, LEAST_RESPONSES // 4 + 1)]
    assert depths == [(1, 1)] * (len(depths) - 1) + [(2, 2)]
    assert answer(1.0, 3) == (2, 2)  # two are responses to what was sent at depth 1, and one counts
    depths = [answer(2.0 + number, 1) for number in range(LEAST_RESPONSES - 1)]
    assert depths == [(2, 2)] * (len(depths) - 1) + [(1, 1)]  # it did not pay


# --- a transfer that cannot wait for a climb ----------------------------------------------------------------------


def test_a_leap_is_a_trial_of_the_bound_that_losses_end() -> None:
    climb = DepthClimb(8)
    climb.leap()
    assert climb.depth == 8
    assert Line(climb, 0.006).run(2_000).climb.depth == 8
    lossy = DepthClimb(8)
    lossy.leap()
    Line(lossy, 0.012, room=1).run(600)
    assert lossy.depth == 1
    lossy.leap()
    assert lossy.depth == 1, "once is enough"


def test_with_a_bound_of_1_there_is_nowhere_to_leap() -> None:
    climb = DepthClimb(1)
    climb.leap()
    assert Line(climb).run(200).climb.depth == 1
