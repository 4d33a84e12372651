"""Odd boards whose verdict needs more than the table says: pauses, units, impossible values, failed imports.

Modules: servolink.doctor.all_responses, servolink.doctor.learn_line, servolink.doctor.learn_motion.
"""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from servolink.boards import ProfileFile
from servolink.client import Board, connect
from servolink.errors import ConnectionLost, MotionRefused, OutcomeUnknown
from servolink.project import Project
from servolink.protocol import Action, FrameParser, QueryServoRequest, SetAngleUnitRequest, Step
from servolink.virtual import BOARDS, BoardTransport
from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.dialects import UnitLies
from tests.lab.odd.firmwares import DeadServo, MixedOrder
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


class Tiring(OddBoard, name="tiring"):
    """Pause inside the header of each response: short in the opening, and longer than anybody waits afterwards."""

    def __init__(self, short: int) -> None:
        super().__init__()
        self.short = short

    def transmit(self, line: OddLine, data: bytes) -> None:
        self.short -= 1
        line.send_in_turn(0.0, data[:5])
        line.send_in_turn(0.6 if self.short >= 0 else 5.5, data[5:])


@pytest.mark.parametrize("short", [13, 19])
def test_a_response_that_a_pause_makes_late_is_not_taken_for_a_loss(short: int, zoo: MakeZoo) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = Tiring(short)
    names, said = board.verdict()
    assert names == ("pauses",), said
    assert "cable" not in said


class VeryLateCopies(OddBoard, name="very-late-copies"):
    """Copy of each response 3 s later, when another opening may be under way."""

    def transmit(self, line: OddLine, data: bytes) -> None:
        line.send(data)
        self.after(3.0, lambda: line.send(data))


def test_copies_are_named_however_late_they_come(zoo: MakeZoo) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = VeryLateCopies()
    names, said = board.verdict()
    assert "late copies" in names, said


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


# --- servos that do not report ----------------------------------------------------------------------------------------


def test_a_dead_servo_is_marked_and_no_motion_starts_from_it(zoo: MakeZoo) -> None:
    board = zoo("dead-servo")
    findings = board("--json", "doctor", "rex").json["findings"]
    assert [(each["check"], "servo 3: not measured" in each["observation"]) for each in findings] == [
        ("impossible values", True)
    ]
    shown = board.on_board("servos").out
    assert shown.count("not measured") == 1
    doubtful = {each["servo_id"]: each["doubt"] for each in board.on_board("--json", "servos").json["servos"]}
    assert doubtful == {1: "", 2: "", 3: "not measured", 4: ""}
    before = [servo.degrees(board.board.now + 9) for servo in board.board.servos.values()]
    refused = board.on_board("move", "1=30", "3=30", "--duration", "0.1")
    assert "servo 3 reports values that cannot be true (not measured)" in refused.err
    assert [servo.degrees(board.board.now + 9) for servo in board.board.servos.values()] == before
    assert board.on_board("move", "1=30", "--duration", "0.1").code == 0
    assert board.on_board("move", "3=30", "--duration", "0.1", "--any-angle", "--no-wait").code == 0
    assert board.board.servos[3].degrees(board.board.now + 9) == 30


class Unreached(OddBoard, name="unreached"):
    """Servo in the list whose state is never sent."""

    def servo_states(self, values: Values) -> Values:
        states = [state for state in super().servo_states(values)["servos"] if state["servoID"] != 2]
        return {"servoCount": len(states), "servos": states}


class OnlyZeros(OddBoard, name="only-zeros"):
    """Servo without a cable: all bytes of its state are 0."""

    def servo_states(self, values: Values) -> Values:
        found = super().servo_states(values)
        for state in found["servos"]:
            if state["servoID"] == 4:
                state.update(dict.fromkeys(["angle", "current", "temperature", "servoType", "isStart", "isHold"], 0))
        return found


@pytest.mark.parametrize(
    ("odd", "check", "words"),
    [
        (Unreached, "servos", "servo 2 is in the list of the board, and not reported, asked singly either"),
        (OnlyZeros, "impossible values", "servo 4: only zeros, unlike the others"),
        (Implausible, "impossible values", "the charge of the battery is 150 %"),
        (Implausible, "impossible values", "100000 of memory are free, of 65536 in all"),
    ],
)
def test_doctor_names_servos_and_values_that_cannot_be_right(
    odd: type[OddBoard], check: str, words: str, zoo: MakeZoo
) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = odd()
    names, said = board.verdict()
    assert {*names} == {check}
    assert words in said


async def _moved(board: OddBoard) -> dict[int, float]:
    async with connect(BoardTransport(board)) as robot:
        with pytest.raises(MotionRefused):
            await robot.move({1: 30}, duration=0.1)
        with pytest.raises(MotionRefused):
            await robot.stream().send({1: 30})
    return {servo_id: servo.degrees(board.now + 9) for servo_id, servo in board.servos.items()}


@pytest.mark.parametrize("odd", [UnitLies, MixedOrder])
def test_a_program_that_has_read_nothing_starts_no_motion_from_impossible_values(
    odd: type[OddBoard], zoo: MakeZoo
) -> None:
    board = odd()
    before = {servo_id: servo.degrees(9) for servo_id, servo in board.servos.items()}
    assert zoo("plain").clock.run(_moved(board)) == before


class FirstDead(DeadServo, name="first-dead"):
    """Servo without a cable, which the action and the macro on the board move."""

    dead = 1

    def __init__(self) -> None:
        super().__init__()
        step = {"servoID": 2, "degree": 25, "interval": 10}
        self.records[30010][5] = {"actionID": 5, "actionCaption": b"", "stepCount": 1, "steps": [step]}
        self.requests: list[str] = []

    def heard(self, line: OddLine, data: bytes) -> None:
        self.requests += [str(packet_id) for packet_id, _ in FrameParser().feed(data)]
        super().heard(line, data)

    @property
    def goals(self) -> dict[int, float]:
        return {servo_id: servo.degrees(self.now + 9) for servo_id, servo in self.servos.items()}


_WAVE = Project(actions=(Action(1, "Wave", (Step(1, 20, 10),)), Action(5, "Nod", (Step(2, 35, 10),))))


async def _run_or_refuse(board: FirstDead) -> None:
    still = board.goals
    async with connect(BoardTransport(board)) as robot:
        for refused in (robot.run_action(1), robot.run_macro(1), robot.play(_WAVE, 1), robot.run_action(1, wait=True)):
            with pytest.raises(MotionRefused, match=r"servo 1 reports values that cannot be true \(not measured\)"):
                await refused
        assert board.goals == still
        await robot.run_action(5, wait=True)
        assert board.goals == {**still, 2: 25}
        await robot.play(_WAVE, 5)
        assert board.goals == {**still, 2: 35}
        await robot.run_action(1, any_angle=True)
        await robot.battery()  # after which the board has begun
        assert board.goals == {**still, 1: 20, 2: 35}
        await robot.release()
        await robot.set_servo(1, start=True, hold=True)
        with pytest.raises(OutcomeUnknown):  # which the dead servo does not confirm
            await robot.stop()
        assert not any(servo.is_start for servo in board.servos.values())


def test_what_is_stored_or_played_starts_from_no_impossible_reading_and_stops_all_the_same(zoo: MakeZoo) -> None:
    zoo("plain").clock.run(_run_or_refuse(FirstDead()))


async def _run_plain(board: FirstDead) -> None:
    async with connect(BoardTransport(board)) as robot:
        for _ in range(3):
            await robot.run_macro(1)
        states = {str(QueryServoRequest.packet_id)}
        assert sum(each in states for each in board.requests) == 1, "read once for a connection"
        assert str(SetAngleUnitRequest.packet_id) not in board.requests


def test_runs_of_a_board_without_doubts_read_the_servos_once_and_set_no_unit(zoo: MakeZoo) -> None:
    board = FirstDead()
    board.dead = 99
    zoo("plain").clock.run(_run_plain(board))


def test_a_shell_runs_from_an_impossible_reading_only_when_told_to(zoo: MakeZoo) -> None:
    board = zoo("plain")
    BOARDS["zoo"] = odd = FirstDead()
    refused = board.on_board("run", "action", "1")
    assert "servo 1 reports values that cannot be true (not measured)" in refused.err
    assert "--any-angle" in refused.err
    assert odd.goals[1] == 0
    assert board.on_board("run", "action", "1", "--any-angle").code == 0
    assert odd.goals[1] == 20


def test_recordings_mark_impossible_values_in_tables_and_summaries(zoo: MakeZoo, tmp_path: Path) -> None:
    board, file = zoo("dead-servo"), tmp_path / "dead.mcap"
    assert board.on_board("record", str(file), "--seconds", "1").code == 0
    assert board("convert", str(file), "--csv", "--channel", "servos", "-o", str(tmp_path / "t.csv")).code == 0
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()))
    assert {(row["servo_id"], row["doubt"]) for row in rows} == {("1", ""), ("2", ""), ("3", "not measured"), ("4", "")}
    assert "not measured" in board("show", str(file)).out
