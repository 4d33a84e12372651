"""Odd boards whose verdict needs more than the table says: pauses, units, impossible values, failed imports.

Modules: servolink.doctor.all_responses, servolink.doctor.learn_line, servolink.doctor.learn_motion.
"""

from __future__ import annotations

import pytest

from servolink.boards import ProfileFile
from servolink.client import Board
from servolink.errors import ConnectionLost
from servolink.virtual import BOARDS
from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.dialects import UnitLies
from tests.lab.odd.wire import Values
from tests.lab.zoo.trials import MakeZoo


class Paused(OddBoard, name="paused"):
    """Pause of a second inside the header of each response."""

    def transmit(self, line: OddLine, data: bytes) -> None:
        line.send_in_turn(0.0, data[:5])
        line.send_in_turn(1.0, data[5:])


def test_pauses_inside_frames_are_named(zoo: MakeZoo) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = Paused()
    assert "pauses" in board.verdict()[0]


def test_an_echo_alone_is_no_fault(zoo: MakeZoo) -> None:
    said = zoo("echoing")("doctor", "rex")
    assert said.code == 0
    assert "came back from the line: an echo" in said.out


# --- units of time and angles -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["slow-moving", "plain"])
def test_a_unit_of_time_is_learnt_only_where_no_other_one_fits(kind: str, zoo: MakeZoo) -> None:
    board = zoo(kind)
    said = board("doctor", "rex", "--learn", "--servo", "1", "--yes")
    profile = ProfileFile("rex").load()
    assert said.code == 0
    assert profile is not None
    unit = profile.settings.interval_unit
    assert unit == 0.01 or (kind == "slow-moving" and unit is None), "never 1 ms, which may fit as well"


def test_a_late_reading_says_nothing_of_commanded_angles(zoo: MakeZoo) -> None:
    said = zoo("very-late")("doctor", "rex", "--learn", "--servo", "1", "--yes")
    assert "it reports the commanded angle" not in said.out


class Tenths(OddBoard, name="tenths"):
    """Angles reported in tenths of a degree."""

    def servo_states(self, values: Values) -> Values:
        found = super().servo_states(values)
        return {**found, "servos": [{**state, "angle": 10 * state["angle"]} for state in found["servos"]]}


def test_another_unit_of_angles_is_suspected_where_a_servo_does_not_arrive(zoo: MakeZoo) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = Tenths()
    said = board("doctor", "rex", "--learn", "--servo", "1", "--yes")
    assert "its angles may be in another unit than degrees" in said.out


def test_impossible_angles_are_marked_and_no_motion_starts_from_them(zoo: MakeZoo) -> None:
    board = zoo("unit-lies")
    lies = board.board
    assert isinstance(lies, UnitLies)
    assert "500° (beyond 360)" in board.on_board("servos").out
    before = [servo.degrees(lies.now + 9) for servo in lies.servos.values()]
    assert "beyond 360" in board.on_board("move", "1=30").err
    assert [servo.degrees(lies.now + 9) for servo in lies.servos.values()] == before
    assert board.on_board("move", "1=530", "--adc", "--duration", "0.2").code == 0


class Implausible(OddBoard, name="implausible"):
    """Charge above 100 %, and more memory free than there is."""

    def remaining_power(self, values: Values) -> Values:
        return {"permil": 1500}

    def memory_size(self, values: Values) -> Values:
        return {"size": 100_000, "totalSize": 65536}


def test_impossible_charge_and_memory_are_marked(zoo: MakeZoo) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = Implausible()
    assert board.on_board("info").out.count("(implausible: ") == 2


# --- failed imports ---------------------------------------------------------------------------------------------------


def test_a_failed_import_ends_with_its_rollback(zoo: MakeZoo) -> None:
    board = zoo("silent-write")
    assert {*board.refusals(("export", "apply", "rollback"))} == {"apply"}
    said = board.on_board("actions")
    assert said.code == 0
    assert "unfinished" not in said.out + said.err


def test_a_record_under_another_id_is_named_and_nothing_more_is_written(zoo: MakeZoo) -> None:
    board = zoo("renumbering")
    found = board.refusals(("export", "apply"))
    assert "action 9 (stored under another id, as action 3)" in found["apply"]
    assert "the same command finishes it" not in found["apply"]
    assert [*board.board.records[30010]] == [1, 2, 3]


def test_an_import_that_dies_before_its_backup_leaves_nothing_to_undo(
    zoo: MakeZoo, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = zoo("plain")
    assert board.refusals(("export", "apply")) == {}

    async def dies(*_: object, **__: object) -> None:
        raise ConnectionLost("the cable was pulled")

    with monkeypatch.context() as patched:
        patched.setattr(Board, "plan_project", dies)
        assert board.on_board("apply", "--yes", str(board.path)).code
    said = board.on_board("rollback", "--yes")
    assert said.code
    assert "ended before its backup was made" in said.err
    assert 9 in board.board.records[30010]
    assert board.on_board("rollback", "1", "--yes").code == 0
    assert 9 not in board.board.records[30010]
