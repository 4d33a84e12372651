"""Boards that do not take what they are given: what is said of it, and that the old project comes back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest

from servolink.client import connect
from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.protocol import ACTION, MACRO, SERVO_PARAMETER, TABLE
from servolink.virtual import AnyType, Storage, VirtualBoard, VirtualTransport
from tests.project.pulled import NEW, OLD_CONTENTS, Make, same
from tests.virtual_time import run

pytestmark = pytest.mark.virtual_only("the tests change the storage of the virtual board itself")

LEFT = "; the import is unfinished: apply another project, or roll back"


def storing(kind: AnyType, change: Callable[[bytes], bytes | None]) -> Callable[[VirtualBoard], None]:
    """Return what makes a board store what `change` makes of records; None for what it refuses."""

    def changed(board: VirtualBoard) -> None:
        put = board.storage.put

        def changing(of: AnyType, records: Mapping[int, bytes], **options: Any) -> bool:
            if of is not kind:
                return put(of, records, **options)
            changed = {record_id: change(content) for record_id, content in records.items()}
            taken = {record_id: content for record_id, content in changed.items() if content is not None}
            return len(taken) == len(changed) and put(of, taken, **options)

        setattr(board.storage, "put", changing)  # noqa: B010 - only this board

    return changed


def without(*names: str) -> Callable[[VirtualBoard], None]:
    """Return what makes a board say yes to something and do nothing."""

    def changed(board: VirtualBoard) -> None:
        for name in names:
            setattr(board.storage, name, lambda *_, **__: True)

    return changed


def all_of(*changes: Callable[[VirtualBoard], None]) -> Callable[[VirtualBoard], None]:
    """Return what makes all these changes."""

    def changed(board: VirtualBoard) -> None:
        for change in changes:
            change(board)

    return changed


def keeping_back(record_id: int) -> Callable[[VirtualBoard], None]:
    """Return what makes a board list a record and not give it."""

    def changed(board: VirtualBoard) -> None:
        get = board.storage.get

        def giving(kind: AnyType, wanted: int) -> bytes | None:
            return None if wanted == record_id else get(kind, wanted)

        setattr(board.storage, "get", giving)  # noqa: B010 - only this board

    return changed


def said_of(
    change: Callable[[VirtualBoard], None],
    folder: Path,
    make: Make | None = None,
    project: Project = NEW,
    *,
    replace: bool = False,
) -> str:
    """Return what is said when a board with this change is given `project`; OLD comes back when it is undone."""

    async def main() -> str:
        odd = (make or Make()).board(OLD_CONTENTS, 1)
        change(odd)
        async with connect(VirtualTransport(odd)) as board:
            with pytest.raises(ProjectError) as caught:
                await board.apply_project(project, folder=folder, replace=replace)
            assert await board.has_unfinished_import()
        good = Make().board(odd.storage.contents, 1)
        async with connect(VirtualTransport(good)) as board:
            await board.rollback_project(folder=folder)
        assert same(good.storage.contents, OLD_CONTENTS)
        return str(caught.value)

    return run(main())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            storing(ACTION, lambda content: content[:4] + content[4:36].upper() + content[36:]),
            "action 2 (the caption comes back as 'NOD'), action 9 (the caption comes back as 'NEW')",
        ),
        (
            storing(ACTION, lambda content: content[:-1] + b"\x01"),
            "action 2 (other steps come back), action 9 (other steps come back)",
        ),
        (storing(MACRO, lambda content: content[:-1] + b"\x01"), "macro 1 (other commands come back)"),
        (storing(ACTION, lambda _: None), "action 2 (refused), action 9 (refused)"),
        (
            all_of(storing(ACTION, lambda _: None), storing(TABLE, lambda _: None)),
            "action 2 (refused), action 9 (refused), joystick table 1 (refused) and 2 more",
        ),
        (
            without("delete"),
            "joystick table 2 (still listed), macro 4 (still listed), action 5 (still listed)",
        ),
        (keeping_back(9), "action 9 (listed and not returned)"),
        (
            storing(SERVO_PARAMETER, lambda content: content[:2] + b"x" + content[3:]),
            "servo parameters (servo 1 comes back",
        ),
        (without("activate"), "active joystick table 1"),
    ],
)
def test_what_a_board_does_not_take_is_named_with_what_it_makes_of_it(
    change: Callable[[VirtualBoard], None], said: str, tmp_path: Path
) -> None:
    found = said_of(change, tmp_path)
    assert found.startswith(f"virtual:// does not accept {said}")
    assert found.endswith(LEFT)


def test_what_is_doubled_for_ever_or_never_there_is_named(tmp_path: Path) -> None:
    said = said_of(without("delete"), tmp_path / "1", Make("append"))
    assert (
        "does not accept joystick table 1 (listed 5 times), joystick table 2 (still listed), macro 1 (listed 5" in said
    )
    only_actions = msgspec.structs.replace(NEW, macros=(), joystick_tables=(), active_joystick_table=None)
    said = said_of(without("put"), tmp_path / "2", project=only_actions)
    assert "servo parameters (servo 3 comes back changed), action 2 (missing afterwards)" in said


def test_a_board_that_deletes_nothing_at_once_is_told_apart(tmp_path: Path) -> None:
    said = said_of(without("clear"), tmp_path, replace=True)
    assert (
        said == f"virtual:// does not accept the command to delete all data (without `replace` it is not needed){LEFT}"
    )


def test_a_project_id_that_a_board_does_not_take_leaves_the_import_unfinished(tmp_path: Path) -> None:
    def stubborn(board: VirtualBoard) -> None:
        board.storage.__class__ = NoEight

    assert said_of(stubborn, tmp_path) == f"virtual:// does not accept project id 88{LEFT}"


class NoEight(Storage):
    """Refuses one project id."""

    @property
    def project_id(self) -> int:
        return super().project_id

    @project_id.setter
    def project_id(self, project_id: int) -> None:
        if project_id != NEW.project_id:
            Storage.project_id.fset(self, project_id)  # type: ignore[attr-defined]
