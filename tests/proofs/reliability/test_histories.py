"""The simulator is worth something if it repeats itself exactly, and if it finds what is wrong."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from servolink.connection import Obstacle, RequestSender, ResponseDispatcher, ResponseWatchdog, Slots
from servolink.motion import StopCounter
from tests import processes
from tests.proofs.reliability import test_model
from tests.proofs.reliability.__main__ import main
from tests.proofs.reliability.history import History, relive
from tests.proofs.reliability.stage import Scene

ROOT = Path(__file__).parents[3]
CLEAN_SLOW, ALL_TOGETHER, RESTARTS = 10, 29, 30
"""Seeds; what each stands for is checked below."""


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
    program = "import json, sys; from tests.proofs.reliability.history import relive; h = relive(29, 300)\n"
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
    history = relive(seed, 100)
    assert history.faults == []
    assert history.counts["right"] > 10


def matching_with(rules: type[Slots]) -> Callable[[pytest.MonkeyPatch], None]:
    def replace(monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(Slots, "__new__", lambda _: object.__new__(rules))

    return replace


def sending_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Slots, "obstacle", lambda self, packet, granted=(): Obstacle.NONE)


def repeating_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RequestSender, "_must_fence", lambda self, call: False)


def forgetting_who_is_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ResponseDispatcher, "leave", lambda self, call: None)


def moving_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StopCounter, "holds", lambda self, ticket: True)


def giving_up_what_arrives(monkeypatch: pytest.MonkeyPatch) -> None:
    def abandon(self: ResponseWatchdog, *_: object) -> None:
        self._parser.abandon_frame()

    monkeypatch.setattr(ResponseWatchdog, "_await_partial_frame", abandon)


@pytest.mark.parametrize(
    ("broken", "first", "fault"),
    [
        (matching_with(test_model.Forgetful), 12, "got "),
        (matching_with(test_model.InTurn), 14, "got "),
        (matching_with(test_model.ForgetfulWithKeys), 12, "got "),
        (matching_with(test_model.NoneToTheOldest), 19, "got "),
        (matching_with(test_model.ResultsToTheOldest), 14, "got "),
        (matching_with(test_model.ToTheNewest), 12, "got "),
        (matching_with(test_model.EqualOnesSettleKeptOnes), 253, "got "),
        (matching_with(test_model.OverdueIsOver), 12, "got "),
        (sending_at_once, 21, "was sent beside others"),
        (repeating_everything, 10, "was sent again"),
        (forgetting_who_is_cancelled, 10, "deadlock"),
        (moving_after_a_stop, 21, "was sent after a stop"),
        (giving_up_what_arrives, 280, "were not found"),
    ],
)
def test_what_is_wrong_with_a_client_is_found(
    broken: Callable[[pytest.MonkeyPatch], None], first: int, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch)
    seeds = range(first, first + 500, 10)  # all with the same line
    assert any(fault in text for seed in seeds for steps in (100, 800) for text in relive(seed, steps).faults)


def test_a_failing_seed_is_shown_with_what_led_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    sending_at_once(monkeypatch)
    history = next(failed for seed in range(10, 600) if (failed := relive(seed, 400)).faults)
    assert history.faults[0].startswith("step ")
    assert [event for _, event, _ in history.latest].count("read") > 2
    assert_same_failure(history)


def assert_same_failure(history: History) -> None:
    again = relive(history.scene.seed, 400)
    assert (again.faults, again.digest, again.latest) == (history.faults, history.digest, history.latest)


def test_the_command_lives_through_one_history(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["reliability", "--seed", "29", "--steps", "100"])
    assert main() == 0
    said = capsys.readouterr().out
    assert said.startswith("seed 29: all together; board: lossy 1 %, slow 3 %; ")
    assert f"history {relive(29, 100).digest}\n" in said
