"""Imports fill the line: the goals of the benchmark, and what they rest on."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from msgspec.structs import replace

from benchmarks.wire import Line
from servolink.client import connect
from servolink.project.transfer.import_plan import Cost, estimated_seconds
from servolink.protocol import ACTION, Codec
from servolink.virtual import BoardKind, VirtualBoard
from tests.proofs import import_speed
from tests.proofs.import_speed import CDC, FEW, FTDI, GOALS, SERIAL, BoardLine, Case


@pytest.mark.parametrize(
    ("case", "line", "depth", "most"),
    [pytest.param(*goal, marks=[] if goal[0] is FEW or goal[1] is CDC else pytest.mark.slow) for goal in GOALS],
)
def test_imports_take_no_longer_than_their_goals(case: Case, line: Line, depth: int, most: float) -> None:
    assert import_speed.seconds_of(case, line, depth) <= most


@pytest.mark.parametrize("line", [FTDI, CDC])
@pytest.mark.parametrize(("held", "wanted"), [(0, 1), (0, 50), (50, 50), (50, 0)])
async def test_a_plan_says_how_long_the_import_takes(line: Line, held: int, wanted: int, tmp_path: Path) -> None:
    board = VirtualBoard(2, kind=BoardKind(memory=2**20))
    session = board.attach(lambda _: None)
    for action in import_speed.library(held).actions:
        session.receive(Codec().encode(ACTION.add(replace(action, action_caption="old"))), 0.0)
    project, loop = import_speed.library(wanted), asyncio.get_running_loop()
    async with connect(BoardLine(line, board)) as connected:
        plan = await connected.plan_project(project)
        begun = loop.time()
        await connected.apply_project(project, folder=tmp_path)
        assert plan.seconds == pytest.approx(loop.time() - begun, rel=0.2)


@pytest.mark.parametrize("pace", [0.0, 11520.0])
def test_the_same_again_is_estimated_to_take_the_same_time(pace: float) -> None:
    reading = Cost(10, 2000)
    assert estimated_seconds(reading, reading, 0.5, pace) == pytest.approx(0.5)
    assert estimated_seconds(Cost(), reading, 0.5, pace) == 0
    assert estimated_seconds(Cost(10, 4000), reading, 0.5, pace) == pytest.approx(0.5 + (2000 / pace if pace else 0))


@pytest.mark.parametrize("depth", [1, 4])
async def test_a_list_that_takes_seconds_arrives_though_responses_were_quick_before(depth: int) -> None:
    board = VirtualBoard(2, kind=BoardKind(memory=2**20))
    session = board.attach(lambda _: None)
    for action in import_speed.library(1800).actions:
        session.receive(Codec().encode(ACTION.add(action)), 0.0)
    async with connect(BoardLine(SERIAL, board), depth=depth) as connected:
        for _ in range(20):
            await connected.project_id()
        assert len(await connected.actions()) == 1800
        assert not sum(connected.stats.skipped.values())
