"""Boards that lie: all that is asked ends in time, by an answer or a typed error, and later the truth gets through."""

from __future__ import annotations

import asyncio
import inspect
import tracemalloc
from contextlib import suppress
from pathlib import Path

import pytest

from servolink.client import Board, connect
from servolink.errors import ConnectionLost, OpenError, RequestTimeout, ServolinkError
from servolink.project import Plan
from servolink.protocol import ButtonEventResponse, Codec
from servolink.virtual import VirtualBoard
from tests.project.pulled import contents_of
from tests.proofs.hostile.calls import PROJECT, Call, calls
from tests.proofs.hostile.corpus import controls
from tests.proofs.hostile.lies import LIES, Lying
from tests.proofs.hostile.lying_board import LyingBoard
from tests.sampling import sampled
from tests.virtual_time import run

_NO_CALLS = {
    *("close", "states", "unit_of", "codec", "connection", "limits"),
    *("profile", "stats", "unanswered", "units", "url"),
}
_MOST_SECONDS = 600.0
"""Of virtual time, which the longest of them takes, whatever the board does."""
_LONGEST_OPENING = 25.0
"""Twice four times the patience: a board that answers too little is waited for until the line is quiet."""
_WHOLE_PROJECTS = {"plan_project", "apply_project", "rollback_project"}
"""Calls that read all of a board, as `export_project` does."""
_AFTERWARDS = 1.0
_LONGEST = 2000  # characters of an error, which may name all servos
_FLOODS = [name for name, how in LIES.items() if how.unasked() != ()]
_FLOODED = 6.0
_MEMORY = 200_000  # bytes: three of the longest frame
_EVENTS = 10_000


_STORED = contents_of(PROJECT)


def lying(how: Lying) -> LyingBoard:
    """Return a board with a project on it that lies so."""
    board = VirtualBoard(4)
    board.storage.contents = _STORED
    return LyingBoard(how.lie(), how.unasked(), board=board)


def test_every_method_of_a_board_is_called(tmp_path: Path) -> None:
    methods = {name for name, _ in inspect.getmembers(Board) if not name.startswith("_")}
    assert {*calls(tmp_path)} == methods - _NO_CALLS


def test_the_truth_is_told_from_a_lie(tmp_path: Path) -> None:
    for method, call in calls(tmp_path).items():
        outcome = run(_outcome(lying(LIES["none"]), call))
        assert isinstance(outcome, Exception) == (method == "rollback_project"), (
            outcome
        )  # there is nothing to go back to
    plan = run(_outcome(lying(LIES["none"]), calls(tmp_path)["plan_project"]))
    assert isinstance(plan, Plan)
    assert plan.changes == ()


@pytest.mark.parametrize("name", sampled(LIES, 5))
def test_a_lie_is_an_answer_or_a_typed_error(name: str, tmp_path: Path) -> None:
    for method, call in calls(tmp_path).items():
        if LIES[name].long and method in _WHOLE_PROJECTS:
            continue
        outcome = run(_outcome(lying(LIES[name]), call))
        if isinstance(outcome, Exception):
            assert not controls(str(outcome)), method
            assert len(str(outcome)) < _LONGEST, method


async def _outcome(board: LyingBoard, call: Call) -> object:
    loop = asyncio.get_running_loop()
    async with board.after_the_handshake() as client:
        begun = loop.time()
        outcome: object
        try:
            outcome = await call(client)
        except ServolinkError as error:
            outcome = error
        assert loop.time() - begun < _MOST_SECONDS
        board.repent()
        await asyncio.sleep(_AFTERWARDS)
        try:
            assert await client.project_id() == board.virtual.storage.project_id
        except (ConnectionLost, RequestTimeout):  # it owes so many answers that none can be told from another
            assert client.stats.timeouts > 1 or client.stats.reopenings
    await asyncio.sleep(0)
    return outcome


@pytest.mark.parametrize("name", LIES)
async def test_a_lie_during_the_handshake_ends_in_time_too(name: str) -> None:
    begun = asyncio.get_running_loop().time()
    with suppress(OpenError):
        async with connect(lying(LIES[name])):
            pass
    assert asyncio.get_running_loop().time() - begun < _LONGEST_OPENING


@pytest.mark.parametrize("name", sampled(_FLOODS, 5))
def test_a_flood_takes_no_memory(name: str) -> None:
    assert run(_peak(lying(LIES[name]))) < _MEMORY


async def _peak(board: LyingBoard) -> int:
    """Return how many bytes a client takes at most while a board says more than it is asked."""
    loop = asyncio.get_running_loop()
    async with board.after_the_handshake(patience=0.5) as client:
        events = client.button_events(limit=100)
        subscribing = asyncio.ensure_future(anext(events))
        await asyncio.sleep(_AFTERWARDS)
        await _ask(client)  # imports what is needed for that
        tracemalloc.start()
        try:
            until = loop.time() + _FLOODED
            while loop.time() < until:
                await _ask(client)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        subscribing.cancel()
        await asyncio.gather(subscribing, events.aclose(), return_exceptions=True)
    return peak


async def _ask(client: Board) -> None:
    with suppress(ServolinkError):
        await client.actions()
    await asyncio.sleep(0.1)


def test_events_that_nobody_reads_are_counted_and_dropped() -> None:
    async def read() -> tuple[int, int, int]:
        board = LyingBoard()
        async with connect(board) as client, client.button_events(limit=8) as events:
            push = Codec().encode(ButtonEventResponse(1, 1))
            for _ in range(_EVENTS):
                board.speak(push)
            return client.stats.events_received, client.stats.events_dropped, events.dropped

    assert run(read()) == (_EVENTS, _EVENTS - 8, _EVENTS - 8)
