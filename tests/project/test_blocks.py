"""Programs made of blocks in project files: kept as they are, and checked by size and shape."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import ProjectError
from servolink.project import ProjectFile
from servolink.project.blocks import MOST_BLOCKS, MOST_LEVELS
from servolink.project.model import Project
from servolink.project.project_file import save_project
from tests.cli.programs import call

WAIT = {"type": "wait", "id": "w", "delay_ms": 2**40}
SERVO = {"type": "servo", "id": "s", "servo_id": 1, "degree": 90}


def stack(*blocks: Any) -> dict[str, Any]:
    return {"x": 1.0, "y": 2.0, "blocks": list(blocks)}


def program(*stacks: Any) -> dict[str, Any]:
    return {"blocks": 1, "stacks": list(stacks), "made": [{"kind": "macros", "id": 3, "caption": "Wave"}]}


def text(blocks: Any) -> str:
    return json.dumps({"schema": 1, "blocks": blocks})


def nested(depth: int) -> dict[str, Any]:
    block: dict[str, Any] = WAIT
    for level in range(depth):
        block = {"type": "repeat", "id": f"r{level}", "loop": 2, "blocks": [block]}
    return block


WAVE = program(
    stack({"type": "macro", "id": "m", "caption": "Wave", "blocks": [nested(2)]}),
    stack({"type": "pose", "id": "p", "caption": "Up", "interval_ms": 500, "blocks": [SERVO]}),
)


def test_blocks_are_read_and_written_unchanged() -> None:
    file = ProjectFile.parse(text(WAVE))
    assert json.loads(ProjectFile(file.project, blocks=file.blocks).text())["blocks"] == WAVE


def test_a_replaced_file_keeps_its_blocks(tmp_path: Path) -> None:
    blocks = ProjectFile.parse(text(WAVE)).blocks
    save_project(tmp_path / "robot", Project(1), blocks=blocks)
    save_project(tmp_path / "robot", Project(2))
    assert ProjectFile.read(tmp_path / "robot") == (Project(2), False, None, blocks)


def test_commands_keep_the_blocks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "robot", tmp_path / "out"
    path.write_text(text(WAVE), encoding="utf-8")
    assert call(capsys, "project", "adjust", str(path), "-o", str(out)).code in {0, 2}
    assert call(capsys, "export", str(path), "--yes", "--url", "virtual://?servos=2").code == 0
    assert ProjectFile.read(path).blocks == ProjectFile.parse(text(WAVE)).blocks


@pytest.mark.parametrize(
    ("blocks", "reason"),
    [
        ({"blocks": 2}, "blocks.blocks: 2 is newer than 1"),
        (program(stack()), "blocks.stacks[0].blocks: has no blocks"),
        (program(stack({"type": "eval", "id": "x"})), "must be one of pose, run_action"),
        (program(stack(WAIT | {"run": "x"})), "'run' is not a field"),
        (program(stack(WAIT | {"id": "\x1b[2J"})), "blocks.stacks[0].blocks[0].id"),
        (program(stack(WAIT | {"delay_ms": 1e300})), "blocks.stacks[0].blocks[0].delay_ms"),
        (program(stack(WAIT), stack(WAIT)), "'w' is also the id of another block"),
        (program(stack(WAIT, SERVO)), "blocks.stacks[0].blocks[1]: cannot follow the block 'w'"),
        (program(stack(nested(MOST_LEVELS))), f"is more than {MOST_LEVELS} blocks deep"),
        (program(stack(*(WAIT | {"id": str(at)} for at in range(MOST_BLOCKS + 1)))), "has more than 1000 blocks"),
        ({**WAVE, "made": [{"kind": "tables", "id": 1, "caption": ""}]}, "blocks.made[0].kind"),
    ],
)
def test_anything_else_is_refused_with_the_place(blocks: Any, reason: str) -> None:
    with pytest.raises(ProjectError) as caught:
        ProjectFile.parse(text(blocks))
    assert reason in str(caught.value)


def test_blocks_nested_beyond_reason_are_refused() -> None:
    inner = '{"type":"repeat","id":"a","loop":1,"blocks":['
    with pytest.raises(ProjectError, match="nested too deeply"):
        ProjectFile.parse(f'{{"schema":1,"blocks":{{"blocks":1,"stacks":[{inner * 5000}{"]}" * 5000}]}}}}')
