"""Imports that are interrupted, on boards of every make, and what must be true afterwards."""

from __future__ import annotations

import shutil
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

import msgspec

from servolink.client import Board, connect
from servolink.errors import ProjectError, ServolinkError
from servolink.project.model import Project
from servolink.project.project_file import load_project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.pinned import ProjectIDBits
from servolink.project.transfer.read import Content
from servolink.project.transfer.writing import writes
from servolink.protocol import (
    CAPTION_SIZE,
    SERVO_PARAMETER,
    STORED_TYPES,
    TABLE,
    Action,
    Button,
    Codec,
    JoystickTable,
    Macro,
    MacroCommand,
    ServoParameter,
    Step,
)
from servolink.transports import Faults, FaultyTransport, Transport
from servolink.virtual import AnyType, BoardKind, Clear, Contents, OnDuplicate, UnknownIds, VirtualBoard
from tests.project.cable import Cable

OLD = Project(
    project_id=77,
    servo_parameters=(ServoParameter(1, -3, "left hip"), ServoParameter(2, 5, "右肩")),
    actions=(
        Action(1, "Bow", (Step(1, 60, 50), Step(2, -60, 50))),
        Action(2, "raw \udcff bytes", (Step(1, 0, 10),)),
        Action(5, "Only old", ()),
    ),
    macros=(Macro(1, "Greet", (MacroCommand(1), MacroCommand(300, 1), MacroCommand(2))), Macro(4, "Old", ())),
    joystick_tables=(JoystickTable(1, "Pad", (Button(3, "Hello", 1),)), JoystickTable(2, "Old pad", ())),
    active_joystick_table=2,
).sorted()
NEW = Project(
    project_id=88,
    servo_parameters=(ServoParameter(1, -3, "left hip"), ServoParameter(3, 1, "neck")),
    actions=(
        Action(1, "Bow", (Step(1, 60, 50), Step(2, -60, 50))),
        Action(2, "Nod", (Step(3, 20, 10), Step(1, 5, 10))),
        Action(9, "New", (Step(2, 1, 1),)),
    ),
    macros=(Macro(1, "Greet", (MacroCommand(1), MacroCommand(500, 1), MacroCommand(9))),),
    joystick_tables=(
        JoystickTable(1, "Pad", (Button(3, "Hello", 1), Button(4, "Nod", 1))),
        JoystickTable(7, "New", ()),
    ),
    active_joystick_table=1,
).sorted()


NO_FAULTS = Faults()


@dataclass(frozen=True)
class Make:
    """One kind of board."""

    on_duplicate: OnDuplicate = "replace"
    clear: Clear = "all"
    partial_writes: bool = False
    bus_powered: bool = False
    project_id_bits: ProjectIDBits = 32
    unknown_ids: UnknownIds = "empty"
    turnaround: float = 0.0
    queue: int = 1000
    depth: int = 1
    """Of the connection to it; a board with a smaller `queue` loses requests."""

    def board(self, contents: Contents, seed: int) -> VirtualBoard:
        """Return such a board, with `contents` stored."""
        board = VirtualBoard(
            3,
            seed,
            kind=BoardKind(
                on_duplicate=self.on_duplicate,
                clear=self.clear,
                partial_writes=self.partial_writes,
                bus_powered=self.bus_powered,
                project_id_bits=self.project_id_bits,
                unknown_ids=self.unknown_ids,
                turnaround=self.turnaround,
                queue=self.queue,
            ),
        )
        board.storage.contents = contents
        board.storage.project_id = contents.project_id  # as much of it as this board keeps
        return board

    def kept(self, project: Project) -> Project:
        """Return `project` as it can be read from such a board."""
        return msgspec.structs.replace(project, project_id=project.project_id & ((1 << self.project_id_bits) - 1))

    def holds(self, contents: Contents, wanted: Contents) -> bool:
        """Return whether such a board returns `wanted`, as far as it can."""
        bits = (1 << self.project_id_bits) - 1
        return same(contents, msgspec.structs.replace(wanted, project_id=wanted.project_id & bits))


MAKES = [
    Make(on_duplicate, clear, partial_writes, bus_powered)
    for on_duplicate in ("replace", "append", "reject")
    for clear in ("all", "records")
    for partial_writes, bus_powered in ((False, False), (False, True), (True, True))
]
_BITS: tuple[ProjectIDBits, ...] = (16, 0)
WEAK_MAKES = [replace(make, project_id_bits=bits) for bits in _BITS for make in MAKES]
"""Boards that keep less than 32 bits of a project id."""
QUEUES = Make(turnaround=0.002, depth=4)
LOSES = Make(turnaround=0.002, queue=0, depth=4)
"""A board that does not queue, although the connection was told that it does."""
DEEP_MAKES = [
    QUEUES,
    LOSES,
    replace(QUEUES, on_duplicate="append", partial_writes=True, bus_powered=True),
    replace(LOSES, on_duplicate="append", partial_writes=True, bus_powered=True),
    replace(LOSES, on_duplicate="reject", clear="records"),
    replace(LOSES, queue=1, unknown_ids="silent"),
    replace(QUEUES, unknown_ids="silent", project_id_bits=16),
]


def contents_of(project: Project) -> Contents:
    """Return what a board has stored that holds `project`."""
    board = VirtualBoard(3)
    session = board.attach(lambda _: None)
    codec = Codec()
    for write in writes(Content(), project):
        session.receive(codec.encode(write.request, unchecked=True), 0.0)
    board.storage.project_id = project.project_id
    return board.storage.contents


def same(contents: Contents, wanted: Contents) -> bool:
    """Return whether two boards give the same, in whatever order, neutral servo parameters aside."""
    return bool(_comparable(contents) == _comparable(wanted))


def _comparable(contents: Contents) -> Any:
    records = {kind: sorted(_to_terminators(kind, one) for _, one in contents.records[kind]) for kind in STORED_TYPES}
    records[SERVO_PARAMETER] = [one for one in records[SERVO_PARAMETER] if any(one[1:])]
    return records, contents.project_id, contents.chosen_table


def _to_terminators(kind: AnyType, record: bytes) -> bytes:
    """Return a record without what is behind the ends of its captions, which a torn write can leave there."""
    starts = [3] if kind is SERVO_PARAMETER else [4]
    if kind is TABLE:
        starts += range(42, len(record), 49)
    for start in starts:
        text = record[start : start + CAPTION_SIZE].partition(b"\0")[0].ljust(CAPTION_SIZE, b"\0")
        record = record[:start] + text + record[start + CAPTION_SIZE :]
    return record


Work = Callable[[Board], Awaitable[Any]]


async def attempt(transport: Transport, work: Work, depth: int = 1) -> ServolinkError | None:
    """Let `work` use a new connection; return what ended it early."""
    try:
        async with connect(transport, depth=depth, write_depth=depth) as board:
            await work(board)
    except ServolinkError as error:
        return error
    return None


@dataclass(frozen=True)
class Pull:
    """Where the cable is pulled: after so many bytes in one direction."""

    sent: int | None = None
    received: int | None = None

    @staticmethod
    def at(byte: int, size: tuple[int, int]) -> Pull:
        """Return the pull at one byte of an import of that `size`, first all that it sends, then all it receives."""
        return Pull(sent=byte + 1) if byte < size[0] else Pull(received=byte - size[0] + 1)


@dataclass(frozen=True)
class History:
    """An import of NEW over OLD on which the cable is pulled, once or more."""

    make: Make
    whole: bool
    pulls: tuple[Pull, ...]
    seed: int = 0
    faults: Faults = NO_FAULTS
    """What else is wrong with the line."""

    async def judge(self, folder: Path) -> Verdict:
        """Let it happen, and see what becomes of both projects; `folder` is a new one."""
        with patch(
            "servolink.project.transfer.backups.choice", Random(self.seed).choice
        ):  # so that it happens again exactly
            return await self._judged(folder)

    async def _judged(self, folder: Path) -> Verdict:
        make = self.make
        board = make.board(OLD_CONTENTS, self.seed)
        lost = False
        for at, pull in enumerate(self.pulls):
            await attempt(self._line(board, pull, at), lambda board: self._import(board, folder), make.depth)
            lost = lost or not (make.holds(board.storage.contents, OLD_CONTENTS) or has_backup(folder, make.kept(OLD)))
        left, kept = board.storage.contents, folder.with_name(folder.name + ".kept")
        if folder.exists():
            shutil.copytree(folder, kept)
        connections = await self._until_done(board, lambda board: self._import(board, folder))
        new = make.holds(board.storage.contents, NEW_CONTENTS)
        board = self.make.board(left, self.seed + 1)
        back = await self._until_done(board, lambda board: undo(board, kept))
        old = make.holds(board.storage.contents, OLD_CONTENTS)
        return Verdict(lost, new, old, max(connections, back))

    async def _import(self, board: Board, folder: Path) -> object:
        return await board.apply_project(NEW, replace=self.whole, folder=folder)

    def _line(self, board: VirtualBoard, pull: Pull, at: int) -> Transport:
        cable = Cable(board, sent=pull.sent, received=pull.received)
        return cable if self.faults == NO_FAULTS else FaultyTransport(cable, self.faults, seed=self.seed + at)

    async def _until_done(self, board: VirtualBoard, work: Work) -> int:
        """Connect until `work` is done; return how many times that took."""
        for count in range(1, MOST):
            if await attempt(self._line(board, Pull(), 100 + count), work, self.make.depth) is None:
                return count
        return MOST


@dataclass(frozen=True)
class Verdict:
    """What became of both projects."""

    lost: bool
    """At some moment the board did not hold the old project, and no backup did."""
    new: bool
    """Applying again ended with the new one on the board."""
    old: bool
    """Rolling back instead ended with the old one."""
    connections: int
    """That it took after the last pull."""

    @property
    def right(self) -> bool:
        """Whether nothing is lost and nothing is wrong."""
        return self.new and self.old and not self.lost


MOST = 20


async def undo(board: Board, folder: Path) -> None:
    """Roll back, unless the import was interrupted before there was anything to roll back."""
    try:
        await board.rollback_project(folder=folder)
    except ProjectError as error:
        if "nothing to undo" not in str(error):
            raise


async def bytes_of_import(make: Make, *, whole: bool, folder: Path) -> tuple[int, int]:
    """Return how many bytes an import that nothing interrupts sends and receives."""
    cable = Cable(make.board(OLD_CONTENTS, 0))
    error = await attempt(cable, lambda board: board.apply_project(NEW, replace=whole, folder=folder), make.depth)
    if error is not None:
        raise error
    return cable.sent, cable.received


def has_backup(folder: Path, project: Project) -> bool:
    """Return whether one of the backups holds `project`."""
    return any(load_project(backup.path, unchecked=True) == project for backup in BackupStore(folder).backups())


OLD_CONTENTS = contents_of(OLD)
NEW_CONTENTS = contents_of(NEW)
