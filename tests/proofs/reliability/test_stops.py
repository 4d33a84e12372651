"""A stop at points of movements: nothing moves after it, and what is wrong with stops is found."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from servolink.client import Board
from servolink.motion import StopCounter
from servolink.protocol import ALL_SERVOS, SetServoParameterRequest
from tests.proofs.reliability.__main__ import main
from tests.proofs.reliability.stop_line import FATES
from tests.proofs.reliability.stop_scene import Scene
from tests.proofs.reliability.stops import MOST_POINTS, SCENES, explore, relive_stop
from tests.sampling import sampled

WITHOUT_MCP = [number for number, scene in enumerate(SCENES) if "model" not in scene and not scene.is_real]
MANY = SCENES.index(Scene("board", "board", "many at once"))


@pytest.mark.parametrize("number", sampled(WITHOUT_MCP, 8))
def test_nothing_moves_after_a_stop_at_any_point(number: int) -> None:
    explored = explore(number, 3)
    assert explored.faults == []
    assert explored.stops.total() == 3


def test_scenes_have_every_door_and_every_fate() -> None:
    assert len(set(SCENES)) == len(SCENES)
    assert {scene.fate for scene in SCENES} == set(FATES)
    assert {scene.mover for scene in SCENES} == {scene.stopper for scene in SCENES}


def test_a_seed_gives_the_same_scene() -> None:
    seed = MANY * MOST_POINTS + 9
    (scene, one), (_, other) = relive_stop(seed), relive_stop(seed)
    assert scene == SCENES[MANY]
    assert one.stop == "confirmed"
    assert [packet for _, packet in one.sent[-8:]] == [packet for _, packet in other.sent[-8:]]


def moving_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StopCounter, "holds", lambda self, ticket: True)


def stopping_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    async def stop(self: Board) -> None:
        """Claim to have stopped."""

    monkeypatch.setattr(Board, "stop", stop)


def stopping_unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    async def stop(self: Board) -> None:
        await self.connection.send_stop(SetServoParameterRequest(ALL_SERVOS, 0, 1))

    monkeypatch.setattr(Board, "stop", stop)


@pytest.mark.parametrize(
    ("broken", "fate", "fault"),
    [
        (moving_after_a_stop, "arrives", "motions were sent after it"),
        (stopping_nothing, "arrives", "it was never written"),
        (stopping_unseen, "is lost", "it was confirmed while servos were started"),
    ],
)
def test_what_is_wrong_with_stops_is_found(
    broken: Callable[[pytest.MonkeyPatch], None], fate: str, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch)
    explored = explore(SCENES.index(Scene("board", "board", "many at once", fate)), 12)
    assert any(fault in text for text in explored.faults)


def test_the_command_lives_through_one_scene(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["reliability", "stops", "--seed", str(MANY * MOST_POINTS + 9)])
    assert main() == 0
    said = capsys.readouterr().out
    assert said.startswith(f"seed {MANY * MOST_POINTS + 9}: many at once, board; stop, board, arrives\n")
    assert said.endswith("stop: confirmed; movement: RequestRefused\n")
