"""`servolink project check`, `preflight` and `schema`.

Module: servolink.cli.projects.source.
"""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from servolink.boards import BoardProfile, BoardSettings, ProfileFile, SafetyLimits
from servolink.project import Project, load_project, save_project
from servolink.protocol import Action, Macro, MacroCommand, Step
from tests.cli.programs import Said, call
from tests.project.projects import HUMANOID, NOD, PAD, RAISE, SHOW, WAVE

WRONG = msgspec.structs.replace(
    HUMANOID,
    macros=(Macro(4, "Wave left", (MacroCommand(1, 0, 50, 2, 5), *WAVE.commands[1:])), SHOW),
    joystick_tables=(
        msgspec.structs.replace(PAD, buttons=(msgspec.structs.replace(PAD.buttons[0], button_up_macro=9),)),
    ),
)
JUMP = Macro(6, "Jump", (MacroCommand(1), MacroCommand(2)))


class File:
    """Runs commands on one project file."""

    def __init__(self, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.path = path
        self._capsys = capsys

    def save(self, project: Project) -> None:
        save_project(self.path, project)

    def __call__(self, command: str, *arguments: str) -> Said:
        return call(self._capsys, "project", command, str(self.path), *arguments)


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> File:
    """A file with a project that is right."""
    file = File(tmp_path / "robot.servolink.json", capsys)
    file.save(HUMANOID)
    return file


class TestCheck:
    """What is wrong."""

    def test_nothing(self, run: File) -> None:
        said = run("check", "--servos", "5", "--memory", "65536", "--speed-cap", "500")
        assert (said.code, said.out, said.err) == (0, f"{run.path}: no problems\n", "")
        assert run("check", "--json").json == {"ok": True, "problems": [], "fixes": []}

    def test_a_line_for_each_problem(self, run: File) -> None:
        run.save(WRONG)
        said = run("check")
        assert said.code == 1
        first, second, last = said.out.splitlines()
        assert first.startswith("warning: macros[0].commands[0].total_interval_ms: is 5; the command takes 2000 ms")
        assert first.endswith(" (--fix repairs it)")
        assert second.startswith("warning: joystick_tables[0].buttons[0].button_up_macro: there is no macro 9")
        assert last == f"{run.path}: 2 problems"
        described = run("check", "--json")
        assert described.code == 1
        assert described.json["ok"] is False
        assert [(one["severity"], one["fixable"]) for one in described.json["problems"]] == [
            ("warning", True),
            ("warning", False),
        ]

    def test_what_can_be_repaired_is(self, run: File) -> None:
        run.save(WRONG)
        said = run("check", "--fix")
        assert said.code == 1
        assert said.out.splitlines()[0].startswith("fixed: macro 4 'Wave left'")
        assert said.out.splitlines()[-1] == f"{run.path}: 1 problem"
        assert load_project(run.path).macros == HUMANOID.macros
        before = run.path.stat().st_ino
        assert run("check", "--fix", "--json").json["fixes"] == []
        assert run.path.stat().st_ino == before

    def test_the_board_it_is_for(self, run: File) -> None:
        assert "there is no servo 5" in run("check", "--servos", "4").out
        assert run("check", "--servos", "1-3, 5,4").code == 0
        assert run("check", "--servos", "5-5").code == 1
        assert "bytes; the board has 100" in run("check", "--memory", "100").out
        run.save(msgspec.structs.replace(HUMANOID, macros=(WAVE, SHOW, JUMP)))
        assert "asks servo 5 for" in run("check", "--speed-cap", "30").out

    def test_captions_of_the_board(self, run: File) -> None:
        run.save(Project(actions=(Action(1, "臺" * 11),)))
        assert "takes 33 bytes in utf-8" in run("check").out
        assert run("check", "--caption-encoding", "big5").code == 0

    def test_a_board(self, run: File, capsys: pytest.CaptureFixture[str]) -> None:
        assert call(capsys, "project", "check", "virtual://").code == 0
        assert call(capsys, "project", "check", "virtual://", "--fix").code == 2

    @pytest.mark.parametrize("servos", ["", "x", "1-", "300", "9-1", "-4", "1,,2"])
    def test_servos_that_are_none(self, servos: str, run: File) -> None:
        assert run("check", f"--servos={servos}").code == 2

    @pytest.mark.parametrize("cap", ["0", "-1", "nan", "fast"])
    def test_a_cap_that_is_none(self, cap: str, run: File) -> None:
        assert run("check", f"--speed-cap={cap}").code == 2
        assert run("preflight", f"--speed-cap={cap}").code == 2


class TestPreflight:
    """What is too fast or goes too far."""

    def test_nothing(self, run: File) -> None:
        said = run("preflight", "--speed-cap", "200", "--limit", "-90", "90")
        assert (said.code, said.out) == (0, "no findings\n")

    def test_a_finding(self, run: File) -> None:
        fast = Action(3, "Fast", (Step(1, 61, 40), Step(3, 94, 40)))
        project = msgspec.structs.replace(
            HUMANOID, actions=(RAISE, NOD, fast), macros=(Macro(4, "M", (MacroCommand(1), MacroCommand(3))),)
        )
        run.save(project)
        said = run("preflight", "M", "--speed-cap", "200")
        assert said.code == 1
        assert said.out.splitlines() == [
            "macros[0].commands[1]: action 3 'Fast', step 2 asks servo 3 for 310 degrees/s; its cap is 200",
            "1 finding",
        ]
        assert run("preflight", "M", "--speed-cap", "200", "--json").json == {
            "ok": False,
            "findings": [
                {
                    "path": "macros[0].commands[1]",
                    "text": "action 3 'Fast', step 2 asks servo 3 for 310 degrees/s; its cap is 200",
                }
            ],
        }
        assert run("preflight", "Nod", "--speed-cap", "200").code == 0

    def test_the_pose_before(self, run: File) -> None:
        assert run("preflight", "Nod", "--speed-cap", "30").code == 0
        said = run("preflight", "Nod", "--speed-cap", "30", "--from", "Raise left arm")
        assert (said.code, "asks servo 5 for 33.3 degrees/s" in said.out) == (1, True)

    def test_limits_of_one_servo_come_first(self, run: File) -> None:
        assert run("preflight", "--limit", "-20", "20").code == 1
        options = ("--servo-limit", "1=0:60", "--servo-limit", "3=-30.5:0")
        assert run("preflight", "--limit", "-20", "20", *options).code == 0
        said = run("preflight", "--servo-limit", "3=-29.5:0")
        assert "step 2 asks servo 3 to go to -30 degrees; its limits are -29.5..0" in said.out
        assert run("preflight", "--servo-limit", "l elbow=-29.5:0").out == said.out
        unknown = run("preflight", "--servo-limit", "tail=-29.5:0")
        assert (unknown.code, "there is no servo 'tail'" in unknown.err) == (1, True)

    def test_limits_of_a_board(self, run: File, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
        limits = SafetyLimits(angles={1: (-50, 50)}, speed_caps={5: 40})
        ProfileFile("rex").save(BoardProfile(limits=limits))
        far = 'step 1 asks servo 1 to go to 60 degrees; its limits are -50..50 (from profile "rex")'
        assert run("preflight", "--profile", "rex").out.splitlines() == [f"actions[0].steps[0]: {far}", "1 finding"]
        assert "limits are -20..20\n" in run("preflight", "--profile", "rex", "--limit", "-20", "20").out
        fast = 'asks servo 5 for 333 degrees/s; its cap is 40 (from profile "rex")'
        ProfileFile("rex").save(BoardProfile(settings=BoardSettings(interval_unit=0.001), limits=limits))
        assert fast in run("preflight", "--profile", "rex").out
        said = run("preflight", "--profile", "max")
        assert (said.code, "'max' has no profile" in said.err) == (2, True)

    @pytest.mark.parametrize(
        "options",
        [
            (),
            ("--limit", "9", "-9"),
            ("--limit", "nan", "9"),
            ("--servo-limit", "3"),
            ("--servo-limit", "3=9:-9"),
            ("--servo-limit", "255=0:1"),
            ("--servo-limit", "1=0:nan"),
        ],
    )
    def test_wrong_usage(self, options: tuple[str, ...], run: File) -> None:
        assert run("preflight", *options).code == 2

    def test_what_is_not_there(self, run: File) -> None:
        said = run("preflight", "none", "--speed-cap", "1")
        assert (said.code, said.out) == (1, "")


def test_the_schema_is_json(capsys: pytest.CaptureFixture[str]) -> None:
    plain, as_json = call(capsys, "project", "schema"), call(capsys, "project", "schema", "--json")
    assert plain.code == 0
    assert plain.out == as_json.out
    assert json.loads(plain.out)["title"] == "servolink project"


def test_a_command_must_be_given(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "project").code == 2
    assert call(capsys, "project", "dance").code == 2
    assert "preflight" in call(capsys, "project", "--help").out


def test_a_file_is_repaired_although_other_errors_remain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    step = '{"servo_id": 1, "degree": 0, "interval_ms": -10}'
    action = f'{{"action_id": 1, "action_caption": "up", "steps": [{step}]}}'
    (tmp_path / "p").write_text(f'{{"schema": 1, "actions": [{action}, {action}]}}', encoding="utf-8")
    said = call(capsys, "project", "check", str(tmp_path / "p"), "--fix")
    assert said.code == 1
    assert "fixed: " in said.out
    assert "steps[0].interval_ms: -10 is outside" in said.out
    assert len(load_project(tmp_path / "p", unchecked=True).actions) == 1
