"""Commands on an odd board, one after the other, in virtual time."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

import pytest

from servolink.boards import ProfileFile
from servolink.virtual import BOARDS
from tests.cli.programs import Said, call
from tests.lab.odd.board import OddBoard
from tests.lab.odd.kinds import KINDS
from tests.lab.zoo.table import COMMANDS
from tests.virtual_time import VirtualClock

GOAL = 10
"""Degrees to which the first servo is moved."""


class Zoo:
    """One board, known to all commands as `rex`, and the project that they write."""

    def __init__(self, kind: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.keeps_records = kind != "servos-only"
        self.board: OddBoard = KINDS[kind]()
        self.seconds = 0.0
        """Virtual seconds of the latest command."""
        self._folder = folder
        self._capsys = capsys
        self.clock = VirtualClock()
        BOARDS["zoo"] = self.board
        assert self("use", "rex", "virtual://zoo").code == 0

    def __call__(self, *arguments: str) -> Said:
        """Run a command."""
        started_at = self.clock.now
        said = call(self._capsys, *arguments)
        self.seconds = self.clock.now - started_at
        return said

    def verdict(self) -> tuple[tuple[str, ...], str]:
        """Return the names of doctor's findings, and their words."""
        findings = self("--json", "doctor", "rex").json["findings"]
        return tuple(finding["check"] for finding in findings), str(findings)

    def learn(self) -> Said:
        """Learn the board, which is not asked for anything but queries."""
        before = [servo.state(self.board.now) for servo in self.board.servos.values()], dict(self.board.records)
        said = self("doctor", "rex", "--learn", "--yes")
        assert ([servo.state(self.board.now) for servo in self.board.servos.values()], self.board.records) == before
        return said

    def learnt(self) -> dict[str, object]:
        """Return the settings kept in the profile."""
        profile = ProfileFile("rex").load()
        assert profile is not None
        settings = profile.settings
        return {
            name: value
            for name in settings.__struct_fields__
            if (value := getattr(settings, name)) is not None and name != "turnaround"
        }

    def refusals(self, commands: Sequence[str] = COMMANDS) -> dict[str, str]:
        """Try `commands`; return the errors of those that refuse. Without an export, nothing is applied."""
        found: dict[str, str] = {}
        for name in commands:
            if "export" in found and name in {"apply", "rollback"}:
                continue
            said = _TRIALS[name](self)
            if said.code:
                found[name] = said.err
        return found

    def on_board(self, *arguments: str) -> Said:
        """Run a command on the board."""
        return self("--board", "rex", *arguments)

    @property
    def servo_id(self) -> int:
        """Id of the first servo, 1 if there is none."""
        return next(iter(self.board.servo_ids), 1)

    @property
    def path(self) -> Path:
        """Project file with one action more than the board has."""
        return self._folder / "robot.json"


def _servos(zoo: Zoo) -> Said:
    said = zoo.on_board("servos", "--json")
    if not said.code:
        assert said.json["servos"][0]["servo_id"] == zoo.servo_id
    return said


def _info(zoo: Zoo) -> Said:
    return zoo.on_board("info")


def _export(zoo: Zoo) -> Said:
    said = zoo.on_board("export", "--yes", str(zoo.path))
    if not said.code:
        project = json.loads(zoo.path.read_text(encoding="utf-8"))
        assert len(project["actions"]) == len(zoo.board.records[30010]) * zoo.keeps_records
        step = {"servo_id": zoo.servo_id, "degree": 50, "interval_ms": 500}
        project["actions"].append({"action_id": 9, "action_caption": "new", "steps": [step]})
        zoo.path.write_text(json.dumps(project), encoding="utf-8")
    return said


def _apply(zoo: Zoo) -> Said:
    said = zoo.on_board("apply", "--yes", str(zoo.path))
    if not said.code:
        if zoo.keeps_records:
            assert zoo.board.records[30010][9]["steps"][0]["degree"] == 50
        else:
            assert 9 not in zoo.board.records[30010]
    return said


def _rollback(zoo: Zoo) -> Said:
    said = zoo.on_board("rollback", "--yes")
    if not said.code:
        assert 9 not in zoo.board.records[30010]
    return said


def _move(zoo: Zoo) -> Said:
    said = zoo.on_board("move", f"{zoo.servo_id}={GOAL}", "--duration", "0.1", "--wait")
    if not said.code:
        assert round(zoo.board.servos[zoo.servo_id].degrees(zoo.board.now)) == GOAL
    return said


def _stop(zoo: Zoo) -> Said:
    said = zoo.on_board("stop")
    stopped = {not servo.is_start for servo in zoo.board.servos.values()}
    if not said.code:
        assert stopped == {True}
    for servo in zoo.board.servos.values():
        servo.is_start = 1
    return said


_TRIALS: dict[str, Callable[[Zoo], Said]] = {
    "servos": _servos,
    "info": _info,
    "export": _export,
    "apply": _apply,
    "rollback": _rollback,
    "move": _move,
    "stop": _stop,
}

MakeZoo: TypeAlias = Callable[[str], Zoo]
"""Function that makes an odd board of a kind."""
