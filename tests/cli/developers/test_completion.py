"""Completion scripts: of all commands and options, and tried in the shell that is there."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from servolink.cli.commands import COMMANDS
from tests import processes
from tests.cli.programs import call

COMPLETE = """
source "$1"
shift
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
_shtab_servolink
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_script_knows_all_commands_and_their_options(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "completion", shell)
    assert (said.code, said.err) == (0, "")
    assert all(name in said.out for name in COMMANDS)
    assert all(option in said.out for option in ("duration", "in-place", "caption-encoding", "scale-time"))


@pytest.mark.skipif(shutil.which("bash") is None, reason="completes in bash")
@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("mo", ["move"]),
        ("move --du", ["--duration"]),
        ("project sch", ["schema"]),
        ("info --byte-order l", ["little"]),
        ("plan robot", ["robot.json"]),
    ],
)
def test_bash_completes(typed: str, completed: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script = tmp_path / "script"
    script.write_text(call(capsys, "completion", "bash").out, encoding="utf-8")
    (tmp_path / "robot.json").touch()
    ran = processes.run(["bash", "-c", COMPLETE, "bash", str(script), "servolink", *typed.split()], cwd=tmp_path)
    assert ran.stdout.split() == completed
