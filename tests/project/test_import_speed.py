"""Imports fill the line: the goals of the benchmark, and what they rest on."""

from __future__ import annotations

import pytest

from benchmarks import import_speed
from benchmarks.import_speed import CDC, FEW, GOALS, SERIAL, BoardLine, Case
from benchmarks.wire import Line
from servolink.client.connect import connect
from servolink.protocol.codec import Codec
from servolink.protocol.record_types import ACTION
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind
from tests.virtual_time import run


@pytest.mark.parametrize(
    ("case", "line", "depth", "most"),
    [pytest.param(*goal, marks=[] if goal[0] is FEW or goal[1] is CDC else pytest.mark.slow) for goal in GOALS],
)
def test_imports_take_no_longer_than_their_goals(case: Case, line: Line, depth: int, most: float) -> None:
    assert import_speed.seconds_of(case, line, depth) <= most


@pytest.mark.parametrize("depth", [1, 4])
def test_a_list_that_takes_seconds_arrives_though_responses_were_quick_before(depth: int) -> None:
    board = VirtualBoard(2, kind=BoardKind(memory=2**20))
    session = board.attach(lambda _: None)
    for action in import_speed.library(1800).actions:
        session.receive(Codec().encode(ACTION.add(action)), 0.0)

    async def main() -> None:
        async with connect(BoardLine(SERIAL, board), depth=depth) as connected:
            for _ in range(20):
                await connected.project_id()
            assert len(await connected.actions()) == 1800
            assert not sum(connected.stats.skipped.values())

    run(main())
