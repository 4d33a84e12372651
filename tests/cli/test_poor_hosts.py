"""Computers on which something is missing: the package of an extra, or a Python that is new enough.

Terminals without UTF-8 are in `test_command_line.py`, missing rights to a device with the transports.
"""

from __future__ import annotations

import ast
import json
import sys
import tomllib
from pathlib import Path

import pytest

import servolink
from servolink.project import Figure, Joint, Project, View, save_project
from servolink.protocol import Action, Step
from servolink.recorder import Event
from tests import processes
from tests.cli.programs import Said, environment
from tests.recorder.files import write as write_recording

PACKAGE = Path(servolink.__file__).parent
ROOT = Path(__file__).parents[2]
FLEET = ("fleet list", "fleet run Wave", "fleet stop", "fleet doctor", "fleet join mqtt://127.0.0.1:1 virtual://")
COMMANDS = {
    "studio": ("studio --no-browser", "studio --demo --no-browser"),
    "record": (
        "record new.mcap --seconds 1",
        "report --yes --seconds 1",
        "spy COM3 --tcp 127.0.0.1:0 --record new.mcap",
    ),
    "twin": ("twin check robot.json", "twin soften robot.json -o soft.json"),
    "foxglove": ("foxglove", "convert recorded.mcap --foxglove"),
    "mcp": ("mcp", "mcp --http 0"),
    "ros2": ("ros2",),
    "fleet": FLEET,
    "metrics": ("fleet metrics",),
}
"""Commands that need an extra, by its name."""
PACKAGES = {
    "studio": ("aiohttp", "segno", "markdown_it"),
    "record": ("mcap", "zstandard", "lz4"),
    "twin": ("mujoco",),
    "foxglove": ("foxglove",),
    "mcp": ("mcp", "uvicorn", "PIL"),
    "ros2": (
        "rclpy",
        "sensor_msgs",
        "std_msgs",
        "std_srvs",
        "trajectory_msgs",
        "diagnostic_msgs",
        "builtin_interfaces",
    ),
    "fleet": ("paho", "keyring"),
    "metrics": ("prometheus_client",),
}
"""Packages that an extra brings, as they are imported."""
WITHOUT_COMMANDS = {"gym", "test", "browser", "docs", "lint", "bench"}

WITHOUT_EXTRAS = """
import json, sys
from tests.support.platforms.other_system import run_all

class Missing:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in missing:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
said = []
for missing, command in json.loads(sys.argv[1]):
    said += run_all([command.split()], "utf-8")
print(json.dumps(said))
"""


def test_each_extra_that_a_command_needs_is_tried() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {*project["optional-dependencies"]} == {*COMMANDS} | WITHOUT_COMMANDS
    assert COMMANDS.keys() == PACKAGES.keys()


def test_a_missing_extra_is_named_in_one_line(tmp_path: Path) -> None:
    arm = Figure(1, "Arm", View(), (Joint("arm", servo=1, length=200, along=(0, 1, 0)),))
    save_project(tmp_path / "robot.json", Project(actions=(Action(1, "Bow", (Step(1, 30, 5),)),)), figure=arm)
    write_recording(tmp_path / "recorded.mcap", [(0.0, Event("mark", "mark", text="here"))])
    table = [(extra, command) for extra, commands in COMMANDS.items() for command in commands]
    changed = {"PYTHONPATH": str(ROOT), "SERVOLINK_BOARD": "virtual://", "SERVOLINK_BROKER": "mqtt://127.0.0.1:1"}
    ran = processes.run(
        [sys.executable, "-c", WITHOUT_EXTRAS, json.dumps([(PACKAGES[extra], command) for extra, command in table])],
        env=environment(**changed),
        cwd=tmp_path,
    )
    assert (ran.returncode, ran.stderr) == (0, "")
    for (extra, command), ended in zip(table, json.loads(ran.stdout), strict=True):
        said = Said(*ended)
        assert said.code == 1, (command, said)
        line = said.err.splitlines()[-1]
        assert line.startswith("servolink: "), (command, said)
        assert f"pip install '.[{extra}]'" in line, (command, said)
    assert {path.name for path in tmp_path.iterdir()} == {"recorded.mcap", "robot.json"}, "nothing was begun"


def test_an_old_python_is_told_which_one_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    source = (PACKAGE / "__init__.py").read_text(encoding="utf-8")
    ast.parse(source, feature_version=(3, 7))  # the oldest that knows annotations of the future
    monkeypatch.setattr(sys, "version_info", (3, 10, 13, "final", 0))
    with pytest.raises(ImportError, match=r"needs Python 3\.11 or newer, and this is Python 3\.10\.13$") as refused:
        exec(compile(source, "<servolink>", "exec"), {})  # noqa: S102 - our own source
    monkeypatch.undo()
    assert refused.value.name == "servolink", "so that `python -m servolink` prints one line"
