"""The same for whole projects: a fault at each operation of an export, a plan, an import and a rollback."""

from __future__ import annotations

import shutil
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
import pytest

from servolink import Action, Board, Project, Step, connect
from servolink.errors import ServolinkError
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.proofs.reliability.test_fault_points import (
    ACTION,
    FAULTS,
    FailingTransport,
    Fault,
    cancelled,
    nothing,
    operations,
    run_stepped,
    stocked_board,
)
from tests.sampling import every, some
from tests.virtual_time import run

Call = Callable[[Board, Path], Awaitable[object]]


async def held(virtual: VirtualBoard) -> Project:
    async with connect(VirtualTransport(virtual)) as board:
        return await board.export_project()


OLD = msgspec.structs.replace(run(held(stocked_board())), project_id=3)
NEW = msgspec.structs.replace(
    OLD, project_id=4, actions=(msgspec.structs.replace(ACTION, steps=(Step(2, 5, 5),)), Action(2, "nod"))
)
CALLS: dict[str, Call] = {
    "export": lambda board, folder: board.export_project(),
    "plan": lambda board, folder: board.plan_project(NEW),
    "apply": lambda board, folder: board.apply_project(NEW, folder=folder),
    "apply at depth 4": lambda board, folder: board.apply_project(NEW, folder=folder),
    "replace": lambda board, folder: board.apply_project(NEW, folder=folder, replace=True),
    "rollback": lambda board, folder: board.rollback_project(folder=folder),
}


def options(name: str) -> dict[str, int]:
    """Return the options of a connection for a call."""
    return {"depth": 4, "write_depth": 4} if name.endswith("depth 4") else {}


async def prepared(name: str, folder: Path) -> VirtualBoard:
    """Return a board with OLD, or, where that is to be brought back, with NEW."""
    virtual = stocked_board()
    async with connect(VirtualTransport(virtual)) as board:
        await board.write_project_id(OLD.project_id)
        if name == "rollback":
            await board.apply_project(NEW, folder=folder)
    return virtual


def same_again(prepared: VirtualBoard, kept: Path, folder: Path) -> VirtualBoard:
    """Return another board that holds the same, with the same files in `folder`."""
    shutil.rmtree(folder, ignore_errors=True)
    if kept.exists():
        shutil.copytree(kept, folder)
    virtual = stocked_board()
    virtual.storage.contents = prepared.storage.contents
    return virtual


async def session(transport: FailingTransport, name: str, folder: Path) -> bool:
    """Connect, do something, close; return whether no error came of it."""
    try:
        async with connect(transport, patience=1.5, **options(name)) as board:  # type: ignore[arg-type]  # only depths
            await CALLS[name](board, folder)
    except ServolinkError:
        return False
    return True


async def assert_nothing_is_lost(name: str, virtual: VirtualBoard, folder: Path, *, done: bool) -> None:
    if name in {"export", "plan"}:
        assert await held(virtual) == OLD
        return
    async with connect(VirtualTransport(virtual)) as board:
        if name != "rollback":
            await CALLS[name](board, folder)
            assert await board.export_project() == NEW
            await board.rollback_project(folder=folder)
        elif not done:
            await board.rollback_project(folder=folder)
        assert await board.export_project() == OLD


@every(59)
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", CALLS)
def test_a_fault_at_any_operation_loses_no_project(name: str, fault: Fault, step: int, tmp_path: Path) -> None:
    folder = tmp_path / "now"
    before = run(prepared(name, tmp_path / "before"))

    async def main(at: int) -> bool:
        virtual = same_again(before, tmp_path / "before", folder)
        transport = FailingTransport(virtual, fault, at)
        done = await session(transport, name, folder)
        await assert_nothing_is_lost(name, virtual, folder, done=done)
        return transport.operations >= at

    # To open is the same for all of them: "export" is enough to try that.
    first = 1 if name == "export" else operations(nothing)[0] + 1
    points = next(at for at in some(first, 1000, step) if not run(main(at))) - 1
    assert points > 20


@every(61)
@pytest.mark.parametrize("name", ["apply", "apply at depth 4", "replace", "rollback"])
def test_it_can_be_cancelled_anywhere(name: str, step: int, tmp_path: Path) -> None:
    folder = tmp_path / "now"
    before = run(prepared(name, tmp_path / "before"))

    async def scene(at: int) -> bool:
        virtual = same_again(before, tmp_path / "before", folder)
        async with connect(VirtualTransport(virtual), **options(name)) as board:  # type: ignore[arg-type]  # only depths

            async def call() -> None:
                await CALLS[name](board, folder)

            was_cancelled = await cancelled(call(), at)
        await assert_nothing_is_lost(name, virtual, folder, done=not was_cancelled)
        return was_cancelled

    turns = next(at for at in some(1, 10_000, step) if not run_stepped(scene(at)))
    assert turns > 50
