"""Odd boards in virtual time: the verdict on each, the learnt settings, and the commands that work on it.

Module: servolink.client.all_servos.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import pytest

from docs.odd_boards import PAGE, with_table
from servolink.support import ExitCode
from tests.lab.odd.board import OddBoard, OddLine
from tests.lab.odd.kinds import KINDS
from tests.lab.odd.lines import OldMode, Resetting
from tests.lab.odd.wire import Values
from tests.lab.zoo.table import COMMANDS, FREE, TABLE, USUAL
from tests.lab.zoo.trials import MakeZoo
from tests.sampling import sampled

ALWAYS = {"plain", "big", "old-at-opening", "twice", "old-firmware", "servos-only", "no-all", "silent"}
"""Kinds that are tried in every run, beside others."""
REFUSED_WITHIN = 6.0
"""Seconds until a device that is not a board is refused."""
WOKEN = "the board was in transmission mode 0, and is in mode 1 now; `servolink board mode 0` puts it back"


def _stay_in_mode_1(board: OddBoard, values: Values) -> Values:
    board.mode = 1
    return {"result": 1}


def check(found: Mapping[str, str], expected: Mapping[str, str], by_chance: frozenset[str] = frozenset()) -> None:
    """Compare the errors of commands with the words expected of each; commands of `by_chance` may refuse too."""
    assert found.keys() - by_chance == expected.keys(), found
    for name, words in expected.items():
        assert words in found[name], name


@pytest.mark.parametrize("kind", sampled(TABLE, 4, ALWAYS))
def test_each_board_is_judged_used_and_learnt_as_the_table_says(kind: str, zoo: MakeZoo) -> None:
    board, row = zoo(kind), TABLE[kind]
    verdict, words = board.verdict()
    assert verdict == row.verdict
    assert row.said in words
    if isinstance(row.refused, str):
        refused = board.refusals(FREE)
        check(refused, dict.fromkeys(refused, row.refused))
    else:
        check(board.refusals(), row.refused, row.by_chance)
    said = board.learn()
    if isinstance(row.learnt, str):
        assert said.code
        assert row.learnt in said.err
    else:
        assert (said.code, said.err) == (0, "")
        expected = {name: value for name, value in (USUAL | dict(row.learnt)).items() if value is not None}
        learnt = board.learnt()
        assert expected | learnt == expected
        assert expected.keys() - learnt.keys() <= row.by_chance
    after = row.refused if row.after is None else row.after
    assert not isinstance(after, str)
    check(board.refusals(), after, row.by_chance)


@pytest.mark.parametrize("kind", ["silent", "chatting", "loop-back", "modem"])
@pytest.mark.parametrize("command", ["doctor", "servos"])
def test_a_device_that_is_not_a_board_is_refused_soon(kind: str, command: str, zoo: MakeZoo) -> None:
    board = zoo(kind)
    assert board(command, *(("rex",) if command == "doctor" else ("--board", "rex"))).code
    assert board.seconds < REFUSED_WITHIN


@pytest.mark.parametrize("command", ["doctor", "servos"])
def test_a_board_with_longer_contents_is_refused_soon_with_the_remedy(command: str, zoo: MakeZoo) -> None:
    board = zoo("padded")
    said = board(command, *(("rex",) if command == "doctor" else ("--board", "rex")))
    assert said.code
    assert "more content than the document says" in said.out + said.err
    assert "ignore_extra=yes" in said.out + said.err
    assert board.seconds < REFUSED_WITHIN


@pytest.mark.parametrize(
    ("kind", "setting"), [("padded", "ignore_extra"), ("twice", "answers_twice"), ("twice-10", "answers_twice")]
)
def test_a_board_is_written_to_with_the_settings_that_it_needs(kind: str, setting: str, zoo: MakeZoo) -> None:
    board = zoo(kind)
    before = dict(board.board.records[30010])
    said = board("doctor", "rex", "--learn", "--write", "--yes")
    assert (said.code, said.err) == (0, "")
    assert board.learnt()[setting] is True
    assert board.learnt()["project_id_bits"] == 32
    assert board.board.records[30010] == before


@pytest.mark.parametrize("command", ["servos", "info", "stop"])
def test_a_board_that_resets_at_the_first_opening_is_opened_once_more(command: str, zoo: MakeZoo) -> None:
    board = zoo("resetting")
    said = board.on_board(command)
    assert (said.code, said.err) == (0, "")
    assert board.seconds < 1


@pytest.mark.parametrize(("resets", "code", "seconds"), [(1, 0, 0.5), (5, 0, 1.5), (100, ExitCode.NO_BOARD, 3.5)])
def test_a_stop_is_repeated_while_the_board_resets(
    resets: int, code: int, seconds: float, zoo: MakeZoo, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(board: Resetting, line: OddLine) -> None:
        if next(board._openings) < resets:  # later than the opening: the stop is on its way by then
            board.after(0.001, line.close)

    monkeypatch.setattr(Resetting, "opened", opened)
    board = zoo("resetting")
    said = board.on_board("stop")
    assert said.code == code, said.err
    assert ("a stop was sent and could not be confirmed; stop again" in said.err) == bool(code)
    assert board.seconds < seconds
    assert code or {servo.is_start for servo in board.board.servos.values()} == {0}


def test_a_board_that_resets_at_each_opening_is_named(zoo: MakeZoo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Resetting, "opened", lambda board, line: line.close())
    said = zoo("resetting").on_board("servos")
    assert said.code == ExitCode.NO_BOARD
    assert "the board may reset when its port is opened, so wait until it has started" in said.err


def test_each_servo_is_stopped_on_a_board_that_ignores_requests_for_all(zoo: MakeZoo) -> None:
    board = zoo("no-all")
    said = board.on_board("stop")
    assert (said.code, said.err) == (0, "")
    assert [servo.is_start for servo in board.board.servos.values()] == [0, 0, 0, 0]
    assert board.on_board("release", "--yes").code == 0
    assert [servo.is_hold for servo in board.board.servos.values()] == [0, 0, 0, 0]
    assert board.learn().code == 0
    assert board.on_board("servo", "start", "all").code == 0
    assert [servo.is_start for servo in board.board.servos.values()] == [1, 1, 1, 1]
    assert board.seconds < 1


def test_a_servo_that_is_listed_twice_is_counted_once(zoo: MakeZoo) -> None:
    board = zoo("listed-twice")
    assert re.search(r"^servos +4$", board.on_board("info").out, re.MULTILINE)
    assert board.on_board("stop").out.startswith("all 4 servos report")


def test_a_confirmed_stop_is_said_where_the_servos_cannot_be_shown(zoo: MakeZoo) -> None:
    board = zoo("text-bridge")
    said = board.on_board("stop")
    assert said.code
    assert "servos report that they are stopped and held; they cannot be shown: SetAngleUnitRequest" in said.err
    assert {servo.is_start for servo in board.board.servos.values()} == {0}


def test_angles_are_shown_as_adc_with_the_reason(zoo: MakeZoo) -> None:
    said = zoo("adc-only").on_board("servos")
    assert said.code == 0
    assert "500 ADC" in said.out
    assert "angles are shown as raw ADC: servo 255 was asked for angle unit 0" in said.err


def test_values_that_are_not_measured_are_named(zoo: MakeZoo) -> None:
    board = zoo("not-measured")
    assert board.on_board("info").out.count("not measured by the board") == 2
    assert board.on_board("--json", "board", "battery").json == {"battery_percent": None}
    assert board("doctor", "rex", "--learn", "--write", "--yes").code == 0
    assert "memory_unit" not in board.learnt()


@pytest.mark.parametrize(("kind", "unit"), [("plain", 1), ("kib", 1024), ("percent", None)])
def test_the_unit_of_memory_is_unknown_until_it_is_learnt(kind: str, unit: int | None, zoo: MakeZoo) -> None:
    board = zoo(kind)
    assert "in a unit not learnt so far" in board.on_board("info").out
    assert board("doctor", "rex", "--learn", "--write", "--yes").code == 0
    assert board.learnt().get("memory_unit") == unit
    shown = board.on_board("board", "memory").out
    assert shown.endswith("in a unit not learnt so far\n" if unit is None else "65,536, bytes\n")


READING = (
    *("servos", "info", "actions", "board battery", "board memory", "board project-id", "bench --requests 2"),
    *("watch --seconds 1 --json", "events --seconds 1", "record {file} --seconds 1"),
    "report --seconds 0 --yes --force -o {file}",
)
"""Commands that only read; `{file}` is a new file in each try."""


@pytest.mark.parametrize("command", READING)
def test_a_board_in_the_old_mode_is_put_back_on_request(command: str, zoo: MakeZoo, tmp_path: Path) -> None:
    board = zoo("old")
    for number, (option, line, mode) in enumerate((("--keep-mode", False, 0), ("", True, 1), ("", False, 1))):
        words = [word.format(file=tmp_path / f"{number}.mcap") for word in command.split()]
        said = board.on_board(*words, *filter(None, [option]))
        assert (said.code, f"{WOKEN}\n" in said.err, board.board.mode) == (0, line, mode)


def test_info_shows_the_mode_found_and_set(zoo: MakeZoo) -> None:
    board = zoo("old")
    assert "0, and 1 during this command" in board.on_board("info", "--keep-mode").out
    assert board.on_board("info", "--keep-mode", "--json").json["transmission_mode"] == {"found": 0, "set": 1}
    assert "1, set by this command; 0 before" in board.on_board("info").out
    assert board.on_board("info", "--json").json["transmission_mode"] == {"found": 1, "set": None}
    assert "1, set at each opening" in board("--board", "virtual://zoo?transmission_mode=1", "info").out


def test_a_learnt_mode_setting_does_not_hinder_putting_a_board_back(zoo: MakeZoo) -> None:
    board = zoo("old-at-opening")
    assert board.learn().code == 0
    said = board.on_board("servos", "--keep-mode")
    assert (said.code, said.err, board.board.mode) == (0, "", 0)


def test_a_board_that_does_not_go_back_is_named(zoo: MakeZoo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(OldMode, "set_mode", _stay_in_mode_1)
    board = zoo("old")
    said = board.on_board("servos", "--keep-mode")
    assert (said.code, said.err, board.board.mode) == (0, f"{WOKEN}\n", 1)


def test_a_board_that_reports_the_commanded_angle_is_learnt(zoo: MakeZoo) -> None:
    board = zoo("no-feedback")
    said = board("doctor", "rex", "--learn", "--servo", "1", "--yes")
    assert said.code == 0
    assert "it reports the commanded angle" in said.out
    assert "interval_unit" not in board.learnt()


def test_a_response_that_contradicts_itself_is_named(zoo: MakeZoo) -> None:
    said = zoo("wrong-count").learn()
    assert "QueryServoList is answered, and the response contradicts itself" in said.out


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("missing-servo", "all 4 servos report that they are stopped and held\n"),
        ("wrong-count", "servos 1, 2, 3, 4, on a board that does not list its servos, are stopped and held\n"),
    ],
)
def test_a_stop_counts_the_servos_in_the_list(zoo: MakeZoo, kind: str, words: str) -> None:
    said = zoo(kind).on_board("stop")
    assert said.out.startswith(words), said.err
    assert len(said.out.splitlines()) == 6


def test_the_page_of_odd_boards_is_made_from_their_declarations() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == with_table(page), "run `python -m docs.odd_boards`"


def test_every_kind_has_a_row() -> None:
    assert KINDS.keys() == TABLE.keys()
    assert all(kind.__doc__ and kind.lesson for kind in KINDS.values())
    refusing = [each for row in TABLE.values() for each in (row.refused, row.after) if isinstance(each, dict)]
    assert all({*each} <= {*COMMANDS} for each in refusing)


def test_no_movement_is_sent_in_a_byte_order_that_the_board_contradicts(zoo: MakeZoo) -> None:
    board = zoo("mixed-order")
    said = board.on_board("move", f"{board.servo_id}=10", "--duration", "0.1")
    assert "cannot be true (fits only the other byte order)" in said.err
    assert abs(board.board.servos[board.servo_id].degrees(board.board.now + 10)) <= 10
