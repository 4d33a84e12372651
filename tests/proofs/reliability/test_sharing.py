"""Programs that share a board: nothing is wrong, and what is wrong with a hub is found."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from servolink.connection import Connection
from servolink.hub import Exchange, FrameProgram, RoundRobin
from servolink.motion import ServoUnits, StopCounter
from tests.proofs.reliability.__main__ import main
from tests.proofs.reliability.hub_history import HubScene, relive_sharing
from tests.sampling import sampled

STOP_WHILE_A_UNIT_IS_SET = 97  # and 40 is a stop while a servo correction waits


def test_seeds_go_through_all_numbers_of_programs_lines_and_boards() -> None:
    scenes = [HubScene.of(seed) for seed in range(150)]
    assert len({(scene.programs, scene.line.name, scene.board.name) for scene in scenes}) == 150
    assert {scene.programs for scene in scenes} == {1, 8, 32}


def test_a_seed_gives_the_same_history() -> None:
    one, other = relive_sharing(STOP_WHILE_A_UNIT_IS_SET, 340), relive_sharing(STOP_WHILE_A_UNIT_IS_SET, 340)
    assert (one.counts, one.latest, one.seconds) == (other.counts, other.latest, other.seconds)


@pytest.mark.parametrize("seed", [*sampled(range(30), 12), STOP_WHILE_A_UNIT_IS_SET])
def test_nothing_is_wrong_on_any_line(seed: int) -> None:
    history = relive_sharing(seed, 340 if seed == STOP_WHILE_A_UNIT_IS_SET else 150)
    assert history.faults == []
    assert history.counts["right"] > 10


def moving_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StopCounter, "holds", lambda self, ticket: True)
    monkeypatch.setattr(RoundRobin, "drop_where", lambda self, unwanted: [])


def sharing_one_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ServoUnits, "needed", lambda *_: ())


def answering_out_of_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def finish_with(self: FrameProgram, exchange: Exchange, frame: bytes | None) -> None:
        if frame is not None and not self.has_left and not exchange.is_over:
            self._send([frame])
        real(self, exchange, None)

    real = FrameProgram.finish_with
    monkeypatch.setattr(FrameProgram, "finish_with", finish_with)


def sending_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    async def send(self: Connection, packet: object, **options: object) -> object:
        await real(self, packet, **options)  # type: ignore[arg-type]
        return await real(self, packet, **options)  # type: ignore[arg-type]

    real = Connection.send
    monkeypatch.setattr(Connection, "send", send)


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("broken", "first", "fault"),
    [
        (moving_after_a_stop, 113, "was sent after a stop"),
        (sharing_one_unit, 1, "was moved in unit"),
        (answering_out_of_order, 1, "had not asked for"),
        (sending_twice, 1, "executed 2 times"),
    ],
)
def test_what_is_wrong_with_a_hub_is_found(
    broken: Callable[[pytest.MonkeyPatch], None], first: int, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken(monkeypatch)
    assert any(fault in text for seed in range(first, first + 450, 3) for text in relive_sharing(seed, 340).faults)


def test_the_command_lives_through_one_history(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["reliability", "hub", "--seed", "5", "--steps", "100"])
    assert main() == 0
    assert capsys.readouterr().out.startswith("seed 5: 32 programs; stalls of 300 ms; board: prompt; depth ")
