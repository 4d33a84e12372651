"""Imports in which one thing fails, each in its turn: a sending, an answer, an operation of the disk."""

from __future__ import annotations

import shutil
from contextlib import suppress
from itertools import takewhile
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.errors import ProjectError, TransportError
from servolink.project.model import Project
from servolink.protocol import Action, Macro, MacroCommand, ServoParameter, Step
from servolink.transports import Transport, WrappedTransport
from servolink.virtual import Contents, VirtualTransport
from tests.project.disk import Disk
from tests.project.pulled import Make, attempt, contents_of, same, undo
from tests.sampling import every, some
from tests.virtual_time import run

BEFORE = Project(7, (ServoParameter(1, 2, "hip"),), (Action(1, "Bow", (Step(1, 5, 9),)),), (Macro(1, "Old", ()),))
AFTER = Project(8, (), (Action(1, "Bow", (Step(1, 6, 9),)),), (Macro(2, "New", (MacroCommand(1),)),))
BEFORE_CONTENTS, AFTER_CONTENTS = contents_of(BEFORE), contents_of(AFTER)


class Line(WrappedTransport):
    """Fails at one sending, as lines and devices do."""

    def __init__(self, inner: Transport, how: str, failing: int) -> None:
        """Fail at the sending of this number, counted from 0: `how` says what happens then."""
        super().__init__(inner)
        self._how = how
        self._left = failing
        self.failed = False

    async def send(self, data: bytes) -> None:
        """Send."""
        self._left -= 1
        if self._left != -1:
            await super().send(data)
            return
        self.failed = True
        if self._how == "unplugged behind it":
            await super().send(data)
            self._break("unplugged")
        elif self._how == "half of it sent":
            await super().send(data[: len(data) // 2])
            self._break("unplugged")
        elif self._how == "not answered":
            await super().send(data)

    def data(self, chunk: bytes, /) -> None:
        """Deliver, but for the answer to what was sent at that moment if it is to be lost."""
        if self._how == "not answered" and self._left == -1:
            self._left -= 1
            return
        super().data(chunk)


async def judge(left: Contents, folder: Path, whole: bool) -> None:
    """See that both projects can be had from what was left."""
    kept = folder.with_name(folder.name + ".kept")
    if folder.exists():
        shutil.copytree(folder, kept)
    forth, back = Make().board(left, 1), Make().board(left, 1)
    async with connect(VirtualTransport(forth)) as board:
        await board.apply_project(AFTER, folder=folder, replace=whole)
    assert same(forth.storage.contents, AFTER_CONTENTS)
    async with connect(VirtualTransport(back)) as board:
        await undo(board, kept)
    assert same(back.storage.contents, BEFORE_CONTENTS)


@every(7)
@pytest.mark.parametrize(
    ("how", "whole"),
    [
        ("unplugged behind it", False),
        ("half of it sent", False),
        ("half of it sent", True),
        ("lost", True),
        ("not answered", False),
    ],
)
def test_a_sending_that_fails_leaves_both_projects(how: str, step: int, tmp_path: Path, *, whole: bool) -> None:
    async def failing(at: int, folder: Path) -> bool:
        """Return whether there was such a sending."""
        virtual = Make().board(BEFORE_CONTENTS, 1)
        line = Line(VirtualTransport(virtual), how, at)
        error = await attempt(line, lambda board: board.apply_project(AFTER, folder=folder, replace=whole))
        if how in ("lost", "not answered"):
            assert error is None
            assert same(virtual.storage.contents, AFTER_CONTENTS)
        elif line.failed:
            assert isinstance(error, TransportError)
            await judge(virtual.storage.contents, folder, whole)
        return line.failed

    assert next(at for at in some(0, 1000, step) if not run(failing(at, tmp_path / str(at)))) > 30


@every(3)
@pytest.mark.parametrize("whole", [False, True], ids=["differences", "replace"])
def test_a_disk_that_fails_leaves_both_projects(
    tmp_path: Path, step: int, monkeypatch: pytest.MonkeyPatch, *, whole: bool
) -> None:
    async def failing(at: int, folder: Path) -> str:
        """Return which operation it was."""
        virtual = Make().board(BEFORE_CONTENTS, 1)
        with monkeypatch.context() as patch:
            async with connect(VirtualTransport(virtual)) as board:
                disk = Disk(patch, at)
                with suppress(ProjectError):  # or none, where it does not matter
                    await board.apply_project(AFTER, folder=folder, replace=whole)
                    assert same(virtual.storage.contents, AFTER_CONTENTS)
        await judge(virtual.storage.contents, folder, whole)
        return disk.failed

    points = some(0, 1000, step)
    seen = list(takewhile(bool, (run(failing(at, tmp_path / str(at))) for at in points)))
    assert len(seen) * step > 20
    if step == 1:
        assert {"mkdir", "open file", "write", "read", "fsync"} <= set(seen)
        assert {"rename", "replace"} & set(seen)
