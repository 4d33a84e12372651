"""Writing tells the rest, and leaves the board as it was, however it ends.

Modules: servolink.doctor.learn_board, servolink.doctor.learn_line, servolink.doctor.learn_trial.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from servolink import connect
from servolink.doctor.learn_board import learn_by_asking, learn_by_writing
from servolink.doctor.learn_line import SharedTransport
from servolink.doctor.learn_queries import make_contact
from servolink.errors import ConnectionLost, OpenError, ProjectError, ServolinkError
from servolink.project import UNFINISHED, BackupStore
from servolink.protocol import ACTION, STORED_TYPES, AddActionRequest, ClearAllDataRequest, Codec
from servolink.transports import Faults
from servolink.virtual import HANDLERS, BoardKind, VirtualBoard, VirtualTransport
from tests.doctor.learning import CHINESE, FULL, URL, board_of, described, learn
from tests.project.cable import Cable
from tests.virtual_time import run

BUSY = 0.005


def everything(board: VirtualBoard) -> object:
    """Return all that is stored, byte for byte; a board that was cleared gets its records back in another order."""
    contents = board.storage.contents
    records = [sorted(contents.records[each]) for each in STORED_TYPES]
    return records, contents.project_id, contents.chosen_table


def test_a_board_as_the_document_describes_it(tmp_path: Path) -> None:
    board = board_of()
    before = board.storage.contents
    found = learn(board, tmp_path)
    assert {name: found[name].value for name in ("memory_unit", "project_id_bits", "on_duplicate", "write_depth")} == {
        "memory_unit": 1,
        "project_id_bits": 32,
        "on_duplicate": "replace",
        "write_depth": 8,
    }
    assert "clear" not in found, "nobody asked for that"
    assert board.storage.contents == before
    (backup,) = BackupStore(tmp_path).backups()
    assert BackupStore(tmp_path).load(backup.path).project_id == 77


@pytest.mark.parametrize(
    ("kind", "codec", "setting", "value"),
    [
        (BoardKind(memory_unit=1024), None, "memory_unit", 1024),
        (BoardKind(memory_unit=1024), Codec("big", "gbk"), "memory_unit", 1024),
        (BoardKind(memory=6 * 1024), None, "memory_unit", 1),
        (BoardKind(memory_unit=1024, memory=8 * 1024), None, "memory_unit", 1024),
        (BoardKind(on_duplicate="append"), None, "on_duplicate", "append"),
        (BoardKind(on_duplicate="reject"), None, "on_duplicate", "reject"),
        (BoardKind(turnaround=BUSY, queue=0), None, "write_depth", 1),
        (BoardKind(turnaround=BUSY, queue=1), None, "write_depth", 2),
        (BoardKind(turnaround=BUSY, queue=4), None, "write_depth", 4),
        (BoardKind(turnaround=BUSY, queue=4, unknown_ids="silent"), None, "write_depth", 4),
        (BoardKind(turnaround=BUSY, queue_bytes=3 * 67), None, "write_depth", 4),
        (BoardKind(write_seconds=0.05), None, "write_depth", 8),
        (BoardKind(clear="records"), None, "clear", "records"),
        (BoardKind(clear="all"), None, "clear", "all"),
        (BoardKind(clear="records", turnaround=BUSY, queue=0), Codec("big"), "clear", "records"),
        (BoardKind(clear_seconds=8.0), None, "clear_seconds", 8.0),
        (BoardKind(clear_seconds=70.0), None, "clear_seconds", 70.0),
        (BoardKind(clear_seconds=8.0, clear="records", on_duplicate="append"), None, "clear_seconds", 8.0),
    ],
    ids=described,
)
def test_each_kind_is_learnt(kind: BoardKind, codec: Codec | None, setting: str, value: Any, tmp_path: Path) -> None:
    captions = CHINESE if codec and codec.caption_encoding == "gbk" else ("wave", "nod", "bow")
    board = board_of(kind, codec, captions)
    before = everything(board)
    found = learn(board, tmp_path, clear="clear" in setting)
    assert found[setting].value == (pytest.approx(value, abs=0.1) if isinstance(value, float) else value)
    assert found[setting].confidence == ("likely" if setting == "clear_seconds" else "certain")
    assert everything(board) == before


@pytest.mark.parametrize("bits", [0, 16])
def test_a_board_that_keeps_less_of_the_project_id(bits: Any, tmp_path: Path) -> None:
    board = board_of(BoardKind(project_id_bits=bits))
    before = everything(board)
    found = learn(board, tmp_path, clear=True)
    assert (found["project_id_bits"].value, found["project_id_bits"].confidence) == (bits, "certain")
    assert everything(board) == before


def test_a_board_that_lies_about_its_memory(tmp_path: Path) -> None:
    board = board_of(BoardKind(memory_reported=1))
    before = everything(board)
    found = learn(board, tmp_path)
    assert found["memory_unit"].confidence != "certain" or found["memory_unit"].value == 1
    assert everything(board) == before


def test_memory_that_is_not_reported_stays_unknown(tmp_path: Path) -> None:
    found = learn(board_of(BoardKind(unsupported=("QueryMemorySize",))), tmp_path)
    assert found["memory_unit"].value is None
    assert found["write_depth"].value == 8


def test_clearing_a_board_with_nothing_to_keep(tmp_path: Path) -> None:
    found = learn(VirtualBoard(servos=2, kind=FULL), tmp_path, clear=True)
    assert (found["clear"].value, found["clear"].confidence) == ("all", "likely"), "only by the marker"


def test_a_full_board_tells_little(tmp_path: Path) -> None:
    board = board_of()
    kind = BoardKind(memory=board.storage.used)
    board = board_of(kind)
    before = everything(board)
    found = learn(board, tmp_path, clear=True)
    for setting in ("memory_unit", "on_duplicate", "write_depth", "clear"):
        assert found[setting].value is None, setting
    assert found["memory_unit"].evidence == "the board stores no more records"
    assert everything(board) == before


@pytest.mark.parametrize(
    ("clearing", "evidence"),
    [
        (lambda context: False, "after clearing the board said no and lists"),
        (lambda context: True, "after clearing the board said yes and lists"),
    ],
)
@pytest.mark.virtual_only("the test changes how the virtual board handles a request")
def test_a_board_that_does_not_clear(clearing: Any, evidence: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setitem(HANDLERS, ClearAllDataRequest, clearing)
    board = board_of()
    before = everything(board)
    found = learn(board, tmp_path, clear=True)
    assert (found["clear"].value, "clear_seconds" in found) == (None, False)
    assert found["clear"].evidence.startswith(evidence)
    assert everything(board) == before


@pytest.mark.virtual_only("the test changes how the virtual board handles a request")
def test_a_board_that_does_not_say_when_it_has_cleared(tmp_path: Path, monkeypatch: Any) -> None:
    clear = HANDLERS[ClearAllDataRequest]
    monkeypatch.setitem(HANDLERS, ClearAllDataRequest, lambda context: None if clear(context) else False)
    board = board_of()
    before = everything(board)
    found = learn(board, tmp_path, clear=True)
    assert found["clear"].value == "all"
    assert found["clear_seconds"].value is None
    assert "not confirmed within" in found["clear_seconds"].evidence
    assert everything(board) == before


def test_a_constant_project_id_says_nothing_about_clearing(tmp_path: Path) -> None:
    board = board_of(BoardKind(project_id_bits=0, clear="all"))
    found = learn(board, tmp_path, clear=True)
    assert (found["clear"].value, found["clear"].confidence) == ("all", "likely"), "by the servo parameters alone"


@pytest.mark.virtual_only("the test changes how the virtual board handles a request")
def test_a_board_that_keeps_old_records_and_says_yes(tmp_path: Path, monkeypatch: Any) -> None:
    add = HANDLERS[AddActionRequest]

    def pretend(context: Any) -> Any:
        known = context.hardware.storage.get(ACTION, context.request.action_id)
        return True if known is not None else add(context)

    monkeypatch.setitem(HANDLERS, AddActionRequest, pretend)
    found = learn(board_of(), tmp_path)
    assert found["on_duplicate"].value is None
    assert "said yes, lists the id once and returns the old record" in found["on_duplicate"].evidence


def test_an_unfinished_import_is_refused(tmp_path: Path) -> None:
    board = board_of()
    board.storage.project_id = UNFINISHED.start + 7
    before = board.storage.contents
    with pytest.raises(ProjectError, match="holds an unfinished import: `servolink apply FILE` finishes it"):
        learn(board, tmp_path)
    assert board.storage.contents is before
    assert not BackupStore(tmp_path).backups()


def test_records_of_an_interrupted_measurement_are_no_content_to_keep(tmp_path: Path) -> None:
    board = board_of(BoardKind(project_id_bits=0))
    whole = Cable(board_of(BoardKind(project_id_bits=0)))
    _learn_over(whole, tmp_path / "whole")
    with pytest.raises((ConnectionLost, OpenError)):
        _learn_over(Cable(board, sent=whole.sent * 2 // 3), tmp_path)
    assert len(board.storage.all(ACTION)) > 3
    with pytest.raises(ProjectError, match="holds records of an interrupted measurement"):
        learn(board, tmp_path)
    assert len(BackupStore(tmp_path).backups()) == 1


def test_there_is_nothing_to_undo_afterwards(tmp_path: Path) -> None:
    board = board_of()
    learn(board, tmp_path)

    async def undo() -> None:
        async with connect(VirtualTransport(board, URL)) as connected:
            await connected.rollback_project(folder=tmp_path)

    with pytest.raises(ProjectError, match="no import from this computer"):
        run(undo())


def test_the_last_import_can_still_be_undone(tmp_path: Path) -> None:
    board = board_of()
    before = board.storage.contents

    async def use(action: str) -> None:
        async with connect(VirtualTransport(board, URL)) as connected:
            project = await connected.export_project()
            if action == "apply":
                await connected.apply_project(type(project)(project_id=5), folder=tmp_path)
            else:
                await connected.rollback_project(folder=tmp_path)

    run(use("apply"))
    learn(board, tmp_path)
    run(use("undo"))
    assert everything(board)[1:] == (77, before.chosen_table)  # type: ignore[index]
    assert board.storage.contents.size == before.size


@pytest.mark.parametrize(
    "kind",
    [
        FULL,
        BoardKind(on_duplicate="append"),
        BoardKind(clear="records", partial_writes=True, bus_powered=True),
        BoardKind(project_id_bits=16),
        BoardKind(project_id_bits=0),
    ],
    ids=described,
)
def test_a_pulled_cable_is_undone_by_a_rollback(kind: BoardKind, tmp_path: Path) -> None:
    """Pulled at many points, from the first byte written to the last one restored."""
    whole = board_of(kind)
    cable = Cable(whole)
    _learn_over(cable, tmp_path / "whole")
    for number in range(0, 6, 2):
        board = board_of(kind)
        before = everything(board)
        folder = tmp_path / str(number)
        pulled = Cable(board, sent=cable.sent * (number + 4) // 10)
        with pytest.raises((ConnectionLost, OpenError)):
            _learn_over(pulled, folder)

        async def undo(board: VirtualBoard = board, folder: Path = folder) -> None:
            async with connect(VirtualTransport(board, URL)) as connected:
                for backup in BackupStore(folder).backups()[:1]:  # none if it was pulled before
                    await connected.rollback_project(backup.path, folder=folder)

        run(undo())
        assert everything(board) == before


def _learn_over(cable: Cable, folder: Path) -> None:
    async def main() -> None:
        shared = SharedTransport(cable)
        try:
            learnt = await learn_by_asking(shared, await make_contact(shared))
            await learn_by_writing(shared, learnt, BackupStore(folder), clear=True)
        finally:
            await shared.free()

    run(main())


TRUTH = {"memory_unit": 1024, "project_id_bits": 32, "on_duplicate": "append", "clear": "records"}


@pytest.mark.parametrize("drop", [0.002, 0.005])
@pytest.mark.parametrize("seed", range(3))
def test_a_bad_line_makes_nothing_wrong_certain(drop: float, seed: int, tmp_path: Path) -> None:
    kind = BoardKind(memory_unit=1024, on_duplicate="append", clear="records", turnaround=BUSY, queue=4)
    board = board_of(kind)
    before = everything(board)
    try:
        found = learn(board, tmp_path, faults=Faults(drop=drop), seed=seed, clear=True)
    except ServolinkError:
        return  # what is on the board can be restored, as after a pulled cable
    assert {name: found[name].value for name in TRUTH if found[name].confidence == "certain"}.items() <= TRUTH.items()
    assert found["write_depth"].value in (None, 1, 2, 4)
    assert everything(board) == before
