"""The board with a body: what hosts see of servos that sag, stall and hang, and a clock that may be late.

Module: servolink.twin.board.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from time import process_time

import pytest

from servolink.client import connect
from servolink.errors import TransportUnavailable
from servolink.transports import create
from servolink.twin.board import LATEST, BodyServo, TwinBoard, read_board
from servolink.virtual import VirtualTransport
from tests.cli.programs import call
from tests.twin.figures import DEMO, arm


def at(board: TwinBoard, seconds: float) -> TwinBoard:
    """Return the board, advanced to a time as by a loop that is on time."""
    for tick in range(round(seconds * 100) + 1):
        board.advance(tick / 100)
    return board


def test_a_heavy_arm_sags_and_its_current_follows_the_torque() -> None:
    board = at(TwinBoard(arm(degrees=90, torque=0.8, stiffness=0.05)), 2)
    state = board.servos[1].state()
    torque = 0.05 * state.angle
    assert abs(state.angle) > 5, "degrees below the command"
    assert state.current == pytest.approx(3 + 897 * abs(torque) / 0.8, rel=0.1)


def test_a_servo_that_is_too_weak_stalls_at_its_highest_current() -> None:
    board = TwinBoard(arm(torque=0.2, stiffness=0.5))
    board.servos[1].move(-90, 0.5, 0.0)
    state = at(board, 3).servos[1].state()
    assert -45 < state.angle < -10
    assert state.current == 900


def test_a_released_servo_hangs_down_and_can_be_turned_by_hand() -> None:
    board = at(TwinBoard(arm(degrees=90, torque=2)), 0.5)
    servo = board.servos[1]
    board.push_servo(1, 40, 0.5)
    assert servo.position == pytest.approx(0, abs=10), "a held servo cannot be pushed"
    servo.set_flags(1, 0, 0.5)
    board.push_servo(1, 170, 0.5)
    assert servo.position == pytest.approx(170)
    assert at(board, 6).servos[1].state().current == 3
    assert servo.position == pytest.approx(90, abs=15)


def test_a_loop_that_was_late_costs_the_body_its_time_only() -> None:
    board = at(TwinBoard(arm()), 0.1)
    board.advance(3600.0)
    assert board.physics.data.time == pytest.approx(0.11 + LATEST, abs=0.011)
    assert board.next_due(3600.0) == pytest.approx(3600.01, abs=0.01)


def test_servos_beyond_the_body_are_as_on_any_board() -> None:
    board = TwinBoard(arm(), servos=3)
    board.servos[3].move(50, 1.0, 0.0)
    assert at(board, 1.5).servos[3].state().angle == 50
    assert len(TwinBoard(arm(), servos=0).servos) == 0


async def test_a_program_makes_the_robot_fall() -> None:
    virtual = read_board(DEMO)
    async with connect(VirtualTransport(virtual)) as board:
        assert await board.servo_ids() == tuple(range(1, 17))
        await board.move({1: 20}, duration=0.5, wait=True)
        assert virtual.physics.data.body("head").xpos[2] > 0.3
        await board.move({8: 80, 13: -80}, duration=1.5, wait=True)
        await asyncio.sleep(1)
        assert virtual.physics.data.body("head").xpos[2] < 0.15, "metres above the floor"
        assert all(isinstance(virtual.servos[servo.servo_id], BodyServo) for servo in await board.servos())


async def test_the_body_takes_less_than_a_third_of_a_core() -> None:
    """Measure CPU, over five seconds of virtual time in which a humanoid moves."""
    async with connect(f"virtual://?twin={DEMO}") as board:
        before = process_time()
        await board.move({1: 60, 4: -60, 9: 30, 14: -30}, duration=5, wait=True)
        assert process_time() - before < 0.3 * 5


def test_a_body_that_is_impossible_here_is_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(TransportUnavailable, match=r"nothing\.json: cannot be read"):
        create(f"virtual://?twin={tmp_path}/nothing.json")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(TransportUnavailable, match=r"the twin needs MuJoCo; .*'\.\[twin\]'"):
        create(f"virtual://?twin={DEMO}")
    said = call(capsys, "virtual", "--twin", str(DEMO))
    assert (said.code, "the twin needs MuJoCo" in said.err) == (1, True)
