"""The cable is pulled in the middle of imports; `python -m benchmarks imports` does it at each byte."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from servolink.project.model import UNFINISHED
from servolink.transports import Faults
from tests.project.cable import Cable
from tests.project.pulled import (
    DEEP_MAKES,
    MAKES,
    NEW,
    NEW_CONTENTS,
    OLD_CONTENTS,
    History,
    Make,
    Pull,
    attempt,
    bytes_of_import,
    same,
)
from tests.sampling import sampled
from tests.virtual_time import run

MAKE_IDS = [
    f"{make.on_duplicate}-{make.clear}{'-partial' * make.partial_writes}{'-bus' * make.bus_powered}" for make in MAKES
]


@pytest.mark.parametrize("whole", [False, True], ids=["differences", "replace"])
@pytest.mark.parametrize("make", sampled(MAKES, 9), ids=MAKE_IDS)
def test_nothing_is_lost_wherever_the_cable_is_pulled(make: Make, tmp_path: Path, *, whole: bool) -> None:
    size = run(bytes_of_import(make, whole=whole, folder=tmp_path / "size"))
    random = Random(f"{make} {whole}")
    for at in range(2):
        pulls = tuple(Pull.at(random.randrange(sum(size)), size) for _ in range(1 + at % 2))
        history = History(make, whole, pulls, seed=at)
        verdict = run(history.judge(tmp_path / str(at)))
        assert verdict.right, history
        assert verdict.connections == 1, history


@pytest.mark.parametrize("seed", range(12))
def test_nothing_is_wrong_on_a_bad_line_either(seed: int, tmp_path: Path) -> None:
    random = Random(seed)
    make, whole = random.choice(MAKES), random.random() < 0.5
    size = run(bytes_of_import(make, whole=whole, folder=tmp_path / "size"))
    faults = Faults(flip=0.0005, drop=0.0002, delay=0.02, delay_time=1.3)
    history = History(make, whole, (Pull.at(random.randrange(sum(size)), size),), seed, faults)
    assert run(history.judge(tmp_path / "one")).right, history


async def test_a_rollback_that_is_interrupted_goes_on_when_it_is_asked_for_again(tmp_path: Path) -> None:
    board = Make().board(OLD_CONTENTS, 1)
    await attempt(Cable(board), lambda board: board.apply_project(NEW, folder=tmp_path))
    assert same(board.storage.contents, NEW_CONTENTS)
    assert await attempt(Cable(board, sent=900), lambda board: board.rollback_project(folder=tmp_path)) is not None
    assert board.storage.project_id in UNFINISHED
    assert await attempt(Cable(board), lambda board: board.rollback_project(folder=tmp_path)) is None
    assert same(board.storage.contents, OLD_CONTENTS)
    assert await attempt(Cable(board), lambda board: board.rollback_project(folder=tmp_path)) is None
    assert same(board.storage.contents, NEW_CONTENTS), "a finished one can be undone itself"


@pytest.mark.parametrize("whole", [False, True], ids=["differences", "replace"])
@pytest.mark.parametrize("make", sampled(DEEP_MAKES, len(DEEP_MAKES) // 2), ids=str)
def test_nothing_is_lost_with_several_requests_under_way(make: Make, tmp_path: Path, *, whole: bool) -> None:
    size = run(bytes_of_import(make, whole=whole, folder=tmp_path / "size"))
    random = Random(f"{make} {whole}")
    for at in range(2):
        pulls = tuple(Pull.at(random.randrange(sum(size)), size) for _ in range(1 + at % 2))
        history = History(make, whole, pulls, seed=at)
        verdict = run(history.judge(tmp_path / str(at)))
        assert verdict.right, history
        assert verdict.connections == 1, history
