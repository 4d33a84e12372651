"""With `--json` an error is one object on one line of standard error; text and exit code are those without it.

Module: servolink.cli.main.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.programs import call
from tests.cli.robot import Robot


def test_a_refused_movement_has_its_class_and_its_text(robot: Robot) -> None:
    words = ("move", "1=30", "--limit", "-5", "5")
    plain, said = robot(*words), robot(*words, "--json")
    assert (plain.code, said.code) == (1, 1)
    error = said.error
    assert (error["kind"], error["reason"]) == ("MotionRefused", "limit")
    assert plain.err == f"servolink: {error['message']}\n"


def test_a_missing_record_has_the_name_of_the_request(robot: Robot) -> None:
    said = robot("action", "show", "9", "--json")
    assert said.code == 1
    assert said.error == {
        "kind": "NotFound",
        "message": "the board has no action 9",
        "request": "QueryActionRequest",
    }


def test_a_request_without_a_response_is_a_timeout(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", "virtual://?unsupported=QueryMemorySize", "board", "memory", "--json")
    assert said.code == 1
    error = said.error
    assert (error["kind"], error["request"]) == ("RequestTimeout", "QueryMemorySizeRequest")


def test_servos_that_do_not_arrive_are_listed(robot: Robot) -> None:
    said = robot("move", "2=360", "--json")
    assert said.code == 1
    error = said.error
    assert (error["kind"], error["late_servo_ids"]) == ("TargetNotReached", [2])


def test_a_board_that_cannot_be_opened_keeps_its_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", "tcp://127.0.0.1:1", "info", "--json")
    assert said.code == 3
    assert (said.error["kind"], said.error["reason"]) == ("OpenError", "not found")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--json move", "the following arguments are required: SERVO=ANGLE"),
        ("move 1=1 --json --nonsense", "`servolink move` has no option --nonsense"),
        ("--json dance", "there is no command 'dance'"),
        ("release --json", "released servos are limp, and raised limbs fall; add --yes if they may"),
        ("info extra --json", "unexpected argument: extra"),
    ],
)
def test_wrong_usage_is_an_object_without_the_usage(
    words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = call(capsys, "--url", "virtual://", *words.split())
    assert said.code == 2
    error = said.error
    assert error["kind"] == "Usage"
    assert error["message"].startswith(message)


def test_json_behind_two_dashes_is_an_argument(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", "virtual://", "action", "show", "--", "--json")
    assert said.code == 1
    assert said.err == "servolink: the board has no action '--json'; there are no actions\n"


def test_hostile_text_is_escaped(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "\x1b[2J\u202egnp\u00e4.json"
    said = call(capsys, "project", "check", str(file), "--json")
    assert said.code == 1
    message = said.error["message"]
    assert "\\x1b[2J\\u202egnp\u00e4" in message
    wrong = call(capsys, "dance\x1b]0;\u202e", "--json")
    assert wrong.code == 2
    assert "\x1b" not in wrong.error["message"]


def test_an_unexpected_error_is_an_internal_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> None:
        raise LookupError("a defect")

    monkeypatch.setattr("servolink.cli.main.parser_of", fail)
    from servolink.cli.main import run

    assert run(["info", "--json"]) == 1
    error = json.loads(capsys.readouterr().err)["error"]
    assert error["kind"] == "InternalError"
    assert error["message"].endswith("LookupError: a defect")
