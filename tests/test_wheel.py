"""The wheel, installed into an empty environment as by someone who writes no programs."""

from __future__ import annotations

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


def test_the_wheel_has_what_type_checkers_and_editors_read(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert "servolink/py.typed" in names
    assert "servolink/project/servolink-project.schema.json" in names
    assert not [name for name in names if not name.startswith("servolink")]
    assert not [name for name in names if name.endswith((".d.ts", "package.json"))], "only checks of the page need them"


def test_the_wheel_has_the_manual_pages(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert [name for name in names if name.endswith(".data/data/share/man/man1/servolink-move.1")]


def test_the_demo_runs_where_nothing_but_the_wheel_is_installed(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "empty", with_pip=True)
    programs = tmp_path / "empty" / ("Scripts" if sys.platform == "win32" else "bin")
    processes.run((str(programs / "python"), "-m", "pip", "install", "--quiet", str(wheel)), check=True)
    demo = processes.run((str(programs / "servolink"), "demo", "--fast"), check=True, cwd=tmp_path)
    assert "All of it worked" in demo.stdout
