"""The simulator is worth something if it repeats itself exactly, and if it finds what is wrong."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.reliability.history import History, relive
from benchmarks.reliability.stage import Scene
from servolink.connection import connection as link
from servolink.connection import dispatcher as answers
from servolink.connection.dispatcher import DeadlineTimer
from servolink.connection.lanes import Lanes
from servolink.protocol.packet import Request
from tests import processes

ROOT = Path(__file__).parents[2]
CLEAN_SLOW, STALLS_SLOW, ALL_TOGETHER, RESTARTS = 10, 11, 29, 30
"""Seeds; what each stands for is checked below."""


def faults(seeds: range) -> Iterator[str]:
    for seed in seeds:
        yield from relive(seed).faults


@pytest.mark.parametrize("seed", [CLEAN_SLOW, ALL_TOGETHER])
def test_a_seed_gives_the_same_history_to_the_last_bit(seed: int) -> None:
    one, other = relive(seed, 300), relive(seed, 300)
    assert (one.digest, one.counts, one.latest, one.seconds) == (
        other.digest,
        other.counts,
        other.latest,
        other.seconds,
    )
    assert one.digest != relive(seed + 50, 300).digest  # the same line and board


def test_a_seed_gives_the_same_history_in_another_process() -> None:
    program = "import json, sys; from benchmarks.reliability.history import relive; h = relive(29, 300)\n"
    program += "json.dump([h.digest, h.counts], sys.stdout)"
    done = processes.run([sys.executable, "-c", program], cwd=ROOT, check=True)
    history = relive(ALL_TOGETHER, 300)
    assert json.loads(done.stdout) == [history.digest, history.counts]


def test_seeds_go_through_all_lines_and_boards() -> None:
    scenes = [Scene.of(seed) for seed in range(50)]
    assert len({(scene.line.name, scene.board.name) for scene in scenes}) == 50
    names = [(scenes[seed].line.name, scenes[seed].board.name) for seed in (10, 11, 29, 30)]
    assert names == [
        ("clean", "slow 3 %"),
        ("stalls of 300 ms", "slow 3 %"),
        ("all together", "lossy 1 %, slow 3 %"),
        ("clean", "restarts, slow 1 %"),
    ]


@pytest.mark.parametrize("seed", range(50))
def test_nothing_is_wrong_on_any_line_with_any_board(seed: int) -> None:
    history = relive(seed, 200)
    assert history.faults == []
    assert history.counts["right"] > 100


def without_fences(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Lanes, "in_doubt", lambda self, lane: False)


def repeating_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "Query", Request)


def forgetting_who_is_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers.ResponseDispatcher, "_over", lambda self, lane, pending: setattr(lane, "pending", None))


def believing_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DeadlineTimer, "_look_again", lambda self, at, received, looks: self._look(at, received, 0))


def moving_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link.Connection, "_refuse_if_moving", lambda self, packet: None)


def giving_up_what_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers.ResponseDispatcher, "_is_arriving", lambda self, due, now: False)


def forgetting_the_connection_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "_lanes_after", lambda before: Lanes())


@pytest.mark.parametrize(
    ("broken", "seeds", "fault"),
    [
        (without_fences, range(10, 110, 50), "got "),
        (repeating_everything, range(20, 120, 50), "was sent again"),
        (forgetting_who_is_cancelled, range(10, 110, 50), "deadlock"),
        (believing_the_clock, range(11, 211, 50), " s early"),
        (moving_after_a_stop, range(10, 30), "was sent after a stop"),
        (giving_up_what_arrives, range(10, 300, 50), "were not found"),
        (forgetting_the_connection_before, range(2963, 2964), "got "),
    ],
)
def test_what_is_wrong_with_a_client_is_found(
    broken: Callable[[pytest.MonkeyPatch], None], seeds: range, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch)
    assert any(fault in text for text in faults(seeds))


def test_a_failing_seed_is_shown_with_what_led_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    without_fences(monkeypatch)
    history = next(failed for seed in range(10, 600, 50) if (failed := relive(seed, 400)).faults)
    assert history.faults[0].startswith("step ")
    assert [event for _, event, _ in history.latest].count("read") > 2
    assert_same_failure(history)


def assert_same_failure(history: History) -> None:
    again = relive(history.scene.seed, 400)
    assert (again.faults, again.digest, again.latest) == (history.faults, history.digest, history.latest)


def test_the_command_lives_through_one_history() -> None:
    command = [sys.executable, "-m", "benchmarks.reliability", "--seed", "29", "--steps", "100"]
    done = processes.run(command, cwd=ROOT, check=True)
    assert done.stdout.startswith("seed 29: all together; board: lossy 1 %, slow 3 %; ")
    assert f"history {relive(29, 100).digest}\n" in done.stdout
