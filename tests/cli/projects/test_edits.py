"""The commands that write projects: `new`, `mirror`, `scale-time`, `merge`, `rename`.

Module: servolink.cli.projects.edit_project.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from servolink.project import Mirror, Project, ProjectFile, load_project, merge_projects, mirror_project, save_project
from servolink.protocol import Action, ServoParameter, Step
from tests.cli.programs import Said, call
from tests.project.projects import HUMANOID, NOD, RAISE, SHOW


class Folder:
    """Runs `servolink project` on files in a folder of its own."""

    def __init__(self, path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.path = path
        self._capsys = capsys
        self.save("robot", HUMANOID)

    def save(self, name: str, project: Project) -> None:
        save_project(self.path / name, project)

    def load(self, name: str) -> Project:
        return load_project(self.path / name)

    def __call__(self, command: str, *arguments: str) -> Said:
        """Run a command; what exists in the folder, or begins with `=`, is a name of a file there."""
        paths = [
            str(self.path / one.removeprefix("=")) if one.startswith("=") or (self.path / one).is_file() else one
            for one in arguments
        ]
        return call(self._capsys, "project", command, *paths)


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Folder:
    """A folder with the file `robot`."""
    return Folder(tmp_path, capsys)


class TestNew:
    """A project to begin with."""

    def test_it_is_small_and_valid(self, run: Folder) -> None:
        said = run("new", "=new", "--servos", "3")
        assert (said.code, said.out) == (0, f"{run.path / 'new'}: written, with 3 servos and action 1 'Rest'\n")
        assert run.load("new") == Project(
            servo_parameters=tuple(ServoParameter(number, 0, f"servo {number}") for number in (1, 2, 3)),
            actions=(Action(1, "Rest", tuple(Step(number, 0, 100) for number in (1, 2, 3))),),
        )
        assert run("check", "new", "--servos", "3").code == 0
        assert run("new", "=most", "--servos", "254", "--json").json == {
            "file": str(run.path / "most"),
            "servos": 254,
            "actions": 1,
        }

    def test_it_takes_the_place_of_nothing(self, run: Folder) -> None:
        said = run("new", "robot")
        assert (said.code, said.out) == (1, "")
        assert "robot: exists already; --force replaces it" in said.err
        assert run.load("robot") == HUMANOID
        assert run("new", "robot", "--force").code == 0
        assert len(run.load("robot").servo_parameters) == 16

    @pytest.mark.parametrize("count", ["0", "255", "-1", "x", "٣"])
    def test_servos_have_a_number(self, count: str, run: Folder) -> None:
        assert run("new", "=new", f"--servos={count}").code == 2
        assert not (run.path / "new").exists()


class TestOutput:
    """What all edits have in common."""

    def test_the_result_goes_into_another_file(self, run: Folder) -> None:
        said = run("rename", "robot", "action", "2", "Yes", "-o", "=out")
        assert (said.code, said.err) == (0, "")
        assert said.out == f"action 2 'Nod' is now 'Yes'\n{run.path / 'out'}: written\n"
        assert run.load("robot") == HUMANOID
        assert run.load("out").actions[1].action_caption == "Yes"

    def test_or_into_the_same(self, run: Folder) -> None:
        said = run("rename", "robot", "action", "2", "Yes", "--in-place", "--json")
        assert said.json == {
            "file": str(run.path / "robot"),
            "written": True,
            "changes": ["action 2 'Nod' is now 'Yes'"],
        }
        assert run.load("robot").actions[1].action_caption == "Yes"

    def test_but_not_into_one_that_is_there(self, run: Folder) -> None:
        run.save("out", Project(project_id=3))
        said = run("rename", "robot", "action", "2", "Yes", "-o", "out")
        assert (said.code, said.out) == (1, "")
        assert run.load("out") == Project(project_id=3)
        assert run("rename", "robot", "action", "2", "Yes", "-o", "out", "--force").code == 0
        assert len(run.load("out").actions) == 2

    def test_what_does_not_change_is_not_written(self, run: Folder) -> None:
        before = (run.path / "robot").stat()
        said = run("rename", "robot", "action", "2", "Nod", "--in-place")
        assert (said.code, said.out) == (0, f"{run.path / 'robot'}: nothing to change\n")
        after = (run.path / "robot").stat()
        assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
        assert run("rename", "robot", "action", "2", "Nod", "--in-place", "--json").json["written"] is False

    def test_what_no_board_could_store_is_not_written(self, run: Folder) -> None:
        said = run("rename", "robot", "action", "2", "x" * 33, "--in-place")
        assert (said.code, said.out) == (1, "")
        assert "a board could not store the result: actions[1]" in said.err
        said = run("rename", "robot", "action", "2", "\x1b[2J", "--in-place")
        assert (said.code, said.out) == (1, "")
        assert "\x1b" not in said.err
        assert run.load("robot") == HUMANOID

    def test_an_export_of_odd_values_can_be_edited(self, run: Folder) -> None:
        odd = Project(actions=(Action(1, "\x1b[2J"), Action(2, "Yes")))
        save_project(run.path / "odd", odd, unchecked=True)
        assert run("rename", "odd", "action", "2", "Hi", "--in-place").code == 0
        edited = ProjectFile.read(run.path / "odd")
        assert edited.unchecked
        assert edited.project.actions == (odd.actions[0], Action(2, "Hi"))
        said = run("rename", "odd", "action", "2", "x" * 33, "--in-place")
        assert said.code == 1
        assert "nothing was written, because the result would have a new error: actions[1]." in said.err
        assert ProjectFile.read(run.path / "odd") == edited

    def test_pairs_that_nothing_moves_are_wrong(self, run: Folder) -> None:
        said = run("mirror", "robot", "Nod", "--map", "98=99", "-o", "=out")
        assert (said.code, said.out) == (2, "")
        assert "no action moves a servo of --map" in said.err
        assert not (run.path / "out").exists()

    def test_captions_are_measured_in_the_encoding_of_the_board(self, run: Folder) -> None:
        caption = "機器人機器人機器人機器人"  # 36 bytes in UTF-8, 24 in Big5
        renaming = ("rename", "robot", "action", "2", caption, "--in-place")
        assert run(*renaming).code == 1
        assert run(*renaming, "--caption-encoding", "big5").code == 0
        assert run("rename", "robot", "action", "2", "é", "--in-place", "--caption-encoding", "ascii").code == 1

    @pytest.mark.parametrize("options", [(), ("-o", "x", "--in-place")])
    def test_where_it_goes_is_said_once(self, options: tuple[str, ...], run: Folder) -> None:
        assert run("rename", "robot", "action", "2", "Yes", *options).code == 2

    def test_a_board_is_only_read(self, run: Folder) -> None:
        said = run("rename", "virtual://", "servo", "1", "arm", "-o", "=out")
        assert said.code == 0
        assert run.load("out") == Project(servo_parameters=(ServoParameter(1, 0, "arm"),))
        refused = run("rename", "virtual://", "servo", "1", "arm", "--in-place")
        assert (refused.code, "`servolink apply`" in refused.err) == (2, True)
        assert run("scale-time", "virtual://", "2", "-o", "=slow").code == 0
        assert run("merge", "virtual://", "robot", "-o", "=both").code == 0
        assert run.load("both") == HUMANOID
        assert run("mirror", "virtual://", "1", "-o", "=image").code == 1

    def test_a_project_that_is_wrong_elsewhere_can_be_repaired(self, run: Folder) -> None:
        odd = msgspec.structs.replace(HUMANOID, actions=(RAISE, Action(2, "\x07")))
        (run.path / "odd").write_text(ProjectFile(odd).text(), encoding="utf-8")
        assert run("rename", "odd", "servo", "5", "head", "--in-place").code == 1
        assert run("rename", "odd", "action", "2", "Bell", "--in-place").code == 0
        assert run.load("odd").actions[1] == Action(2, "Bell")


class TestMirror:
    """Left and right exchanged."""

    def test_by_captions(self, run: Folder) -> None:
        said = run("mirror", "robot", "Show", "--in-place")
        assert said.code == 0
        assert said.out.splitlines() == [
            "pairs: 1=2, 3=4",
            "action 1 'Raise left arm' mirrored as action 3 'Raise right arm'",
            "macro 4 'Wave left' mirrored as macro 1 'Wave right'",
            "macro 5 'Show' mirrored as macro 2 'Show mirrored'",
            f"{run.path / 'robot'}: written",
        ]
        image, _ = mirror_project(HUMANOID, [SHOW], Mirror({1: 2, 2: 1, 3: 4, 4: 3}))
        assert run.load("robot") == image.sorted()
        again = run("mirror", "robot", "Show", "--in-place", "--json").json
        assert (again["written"], again["pairs"]) == (False, [[1, 2], [3, 4]])

    def test_by_a_map(self, run: Folder) -> None:
        said = run("mirror", "robot", "action:1", "--map", "1=4,5=5", "--same-sign", "4", "-o", "=out")
        assert said.code == 0
        assert run.load("out").actions[2].steps == (Step(4, 60, 50), Step(3, -30, 40), Step(5, -10, 20))

    @pytest.mark.parametrize(
        "options",
        [
            ("--map", "1"),
            ("--map", "1=2,1=3"),
            ("--map", "1=255"),
            ("--map", ""),
            ("--same-sign", "5"),
        ],
    )
    def test_wrong_usage(self, options: tuple[str, ...], run: Folder) -> None:
        assert run("mirror", "robot", "Nod", "Show", *options, "--in-place").code == 2
        assert run.load("robot") == HUMANOID

    def test_a_map_of_captions(self, run: Folder) -> None:
        options = ("--map", "left shoulder=r elbow,name:neck=neck", "--same-sign", "R elbow")
        assert run("mirror", "robot", "action:1", *options, "-o", "=out").code == 0
        assert run.load("out").actions[2].steps == (Step(4, 60, 50), Step(3, -30, 40), Step(5, -10, 20))
        said = run("mirror", "robot", "action:1", "--map", "1=4,L elbow=4", "-o", "=other")
        assert (said.code, "servo 4 has two partners in --map" in said.err) == (2, True)

    @pytest.mark.parametrize("option", ["--map", "--same-sign"])
    def test_a_servo_that_is_not_there(self, option: str, run: Folder) -> None:
        said = run("mirror", "robot", "Nod", option, "tail=1" if option == "--map" else "tail", "--in-place")
        assert (said.code, said.out) == (1, "")
        assert "there is no servo 'tail'" in said.err
        assert run.load("robot") == HUMANOID

    def test_captions_that_say_nothing(self, run: Folder) -> None:
        said = run("mirror", "robot", "Nod", "--in-place")
        assert (said.code, said.out) == (1, "")
        assert "1=2,3=4" in said.err

    def test_the_help_says_which_way_servos_turn(self, run: Folder) -> None:
        assert "opposite of its partner's angle" in " ".join(run("mirror", "--help").out.split())


class TestScaleTime:
    """Times multiplied."""

    def test_one_action_and_the_macros_that_call_it(self, run: Folder) -> None:
        said = run("scale-time", "robot", "2", "Raise left arm", "--in-place")
        assert said.code == 0
        project = run.load("robot")
        assert project.actions[0].steps[0].interval == 100
        assert project.actions[1] == NOD
        assert [one.total_interval for one in project.macros[0].commands] == [4000, 300]
        assert [one.total_interval for one in project.macros[1].commands] == [4300, 300]
        assert run("check", "robot").code == 0

    def test_everything(self, run: Folder) -> None:
        assert run("scale-time", "robot", "0.5", "-o", "=out", "--json").json["written"] is True
        project = run.load("out")
        assert [one.steps[0].interval for one in project.actions] == [25, 15]
        assert project.macros[0].commands[1].command_id == 150
        assert run("check", "out").code == 0

    @pytest.mark.parametrize("factor", ["0", "-1", "nan", "inf", "1e9"])
    def test_what_is_no_factor(self, factor: str, run: Folder) -> None:
        assert run("scale-time", "robot", factor, "--in-place").code == 2
        assert run.load("robot") == HUMANOID


class TestMerge:
    """Two in one."""

    def test_new_ids_are_told(self, run: Folder) -> None:
        other = msgspec.structs.replace(HUMANOID, actions=(Action(1, "Bow", (Step(5, 9, 5),)), NOD))
        run.save("other", other)
        said = run("merge", "robot", "other", "-o", "=out")
        assert said.code == 0
        assert "action 1 'Bow' added as 3\n" in said.out
        assert run.load("out") == merge_projects(HUMANOID, other)[0].sorted()

    def test_with_itself_nothing_changes(self, run: Folder) -> None:
        assert run("merge", "robot", "robot", "--in-place", "--json").json == {
            "file": str(run.path / "robot"),
            "written": False,
            "changes": [],
        }

    def test_what_calls_nothing_does_not_call_something_by_chance(self, run: Folder) -> None:
        run.save(
            "lost", msgspec.structs.replace(HUMANOID, actions=(NOD,), joystick_tables=(), active_joystick_table=None)
        )
        said = run("merge", "robot", "lost", "-o", "=out")
        assert (said.code, said.out) == (1, "")
        assert "macro 4 'Wave left' refers to action 1, which is missing" in said.err


class TestRename:
    """Other captions."""

    @pytest.mark.parametrize("kind", ["action", "macro", "table", "servo"])
    def test_each_kind(self, kind: str, run: Folder) -> None:
        number = {"action": "1", "macro": "4", "table": "7", "servo": "1"}[kind]
        assert run("rename", "robot", kind, number, "名", "--in-place").code == 0
        shelf = {"action": "actions", "macro": "macros", "table": "joystick_tables", "servo": "servo_parameters"}[kind]
        assert "名" in str(getattr(run.load("robot"), shelf)[0])

    def test_what_is_not_there(self, run: Folder) -> None:
        said = run("rename", "robot", "table", "9", "x", "--in-place")
        assert (said.code, "there is no joystick table 9" in said.err) == (1, True)
