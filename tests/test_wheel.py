"""The wheel, installed into an empty environment as by someone who writes no programs."""

from __future__ import annotations

import os
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from tests import processes

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    build = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    processes.run((*build, "--wheel-dir", str(folder), str(ROOT)), check=True)
    (built,) = folder.iterdir()
    return built


def installed(folder: Path, *packages: str) -> Path:
    """Install packages into a new environment, and return the folder of its programs."""
    venv.create(folder, with_pip=True)
    programs = folder / ("Scripts" if sys.platform == "win32" else "bin")
    processes.run((str(programs / "python"), "-m", "pip", "install", "--quiet", *packages), check=True)
    return programs


def test_the_wheel_has_what_type_checkers_and_editors_read(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert "servolink/py.typed" in names
    assert "servolink/project/servolink-project.schema.json" in names
    assert not [name for name in names if not name.startswith("servolink")]
    assert not [name for name in names if name.endswith((".d.ts", "package.json"))], "only checks of the page need them"


def test_the_wheel_has_the_manual_pages(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert [name for name in names if name.endswith(".data/data/share/man/man1/servolink-move.1")]


def test_the_wheel_has_the_hook_of_pyinstaller_and_its_entry_point(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    assert "servolink/__pyinstaller/hook-servolink.py" in archive.namelist()
    (points,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
    assert "[pyinstaller40]\nhook-dirs = servolink.__pyinstaller:hook_folders\n" in archive.read(points).decode()


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("--help", "usage: servolink"),
        ("--board virtual:// servos", "ready"),
        ("firmware info", "SHA-256"),
        ("wireshark", "local FIELDS"),
        ("doctor virtual://", "nothing is wrong"),
    ],
)
def test_commands_run_from_a_zip_file(wheel: Path, command: str, said: str, tmp_path: Path) -> None:
    arguments = (sys.executable, "-m", "servolink", *command.split())
    done = processes.run(arguments, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(wheel)}, check=True)
    assert said in done.stdout


@pytest.mark.timeout(1200)
def test_a_frozen_program_connects_and_runs_commands(wheel: Path, tmp_path: Path) -> None:
    programs = installed(tmp_path / "packing", str(wheel), "pyinstaller>=6")
    program = tmp_path / "robot.py"
    program.write_text(FROZEN, encoding="utf-8")
    processes.run((str(programs / "pyinstaller"), "--onedir", str(program)), cwd=tmp_path, check=True, limit=1000)
    robot = str(tmp_path / "dist/robot/robot")
    assert processes.run((robot,), check=True).stdout == "3\n"
    assert "ready" in processes.run((robot, "--board", "virtual://", "servos"), check=True).stdout


FROZEN = """
import sys
from servolink import sync
from servolink.__main__ import main

if sys.argv[1:]:
    sys.exit(main())
with sync.connect("virtual://?servos=3") as board:
    print(len(board.servos()))
"""


def test_the_demo_runs_where_nothing_but_the_wheel_is_installed(wheel: Path, tmp_path: Path) -> None:
    programs = installed(tmp_path / "empty", str(wheel))
    demo = processes.run((str(programs / "servolink"), "demo", "--fast"), check=True, cwd=tmp_path)
    assert "All of it worked" in demo.stdout
