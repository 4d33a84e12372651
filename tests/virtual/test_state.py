"""What is written to a state file, and which files are refused.

Module: servolink.virtual.state_file.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import get_args

import pytest
from msgspec.structs import replace

from servolink.errors import ServolinkError
from servolink.protocol import (
    MACRO,
    STORED_TYPES,
    TABLE,
    AddJoystickTableRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    Button,
    Codec,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroCommand,
    ServoParameter,
    SetActiveJoystickTableRequest,
    Step,
    WriteProjectIDRequest,
    encode_frame,
)
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind, OnDuplicate
from servolink.virtual.state_file import load_state, save_state
from tests.virtual.host import START, Host


@pytest.fixture(params=["little", "big"])
def board(request: pytest.FixtureRequest) -> VirtualBoard:
    """A board with something of each kind, a hostile caption among it."""
    host = Host(VirtualBoard(servos=3, codec=Codec(request.param)))
    host.store_action(5, (1, 90, 100))
    hostile = b"\xff\xfe\x1b[2J\0after the end".ljust(32, b"\x80")
    content = (6).to_bytes(4, request.param) + hostile + bytes(2)
    host.session.receive(encode_frame(30030, content, request.param), START)
    host.store_macro(2, MacroCommand(5, ratio=50))
    for table_id in (1, 2):
        host.ask(AddJoystickTableRequest(table_id, "pad", (Button(1, "A", 2),)))
    host.ask(SetActiveJoystickTableRequest(2))
    host.ask(AddServoParameterRequest((ServoParameter(2, -4, "knee"),)))
    host.ask(WriteProjectIDRequest(77))
    host.tell(ExecuteActionRequest((Step(1, 45, 0),)))
    host.board.advance(START + 3600)
    return host.board


def kept(board: VirtualBoard) -> object:
    storage = board.storage
    records = {kind: storage.all(kind) for kind in STORED_TYPES}
    angles = [servo.angle for servo in board.servos.values()]
    return records, storage.project_id, storage.active_table, storage.used, round(board.battery, 6), angles


def test_a_loaded_board_is_the_saved_one(board: VirtualBoard, tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    save_state(board, path)
    loaded = VirtualBoard(servos=3, codec=board.codec, seed=99)
    load_state(loaded, path)
    assert kept(loaded) == kept(board)
    assert loaded.next_due(START) is None


def test_saving_replaces_the_file_and_leaves_nothing_else(board: VirtualBoard, tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    path.write_text("old")
    save_state(board, path)
    assert [child.name for child in tmp_path.iterdir()] == ["board.json"]
    assert json.loads(path.read_text())["byte_order"] == board.codec.byte_order


def test_a_save_that_fails_keeps_the_old_file(board: VirtualBoard, tmp_path: Path) -> None:
    path = tmp_path / "folder"
    path.mkdir()
    (path / "inside").write_text("kept")
    with pytest.raises(ServolinkError, match=r"folder: the board cannot be saved: .*directory"):
        save_state(board, path)
    assert [child.name for child in tmp_path.iterdir()] == ["folder"]
    assert (path / "inside").read_text() == "kept"


def test_no_file_is_a_fresh_board(tmp_path: Path) -> None:
    board = VirtualBoard()
    before = kept(board)
    load_state(board, tmp_path / "missing.json")
    assert kept(board) == before


def test_angles_of_servos_that_are_not_there_are_left_out(board: VirtualBoard, tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    save_state(board, path)
    small = VirtualBoard(servos=2, codec=board.codec)
    load_state(small, path)
    assert [servo.angle for servo in small.servos.values()] == [
        servo.angle for servo in list(board.servos.values())[:2]
    ]


def _saved(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "board.json"
    save_state(VirtualBoard(servos=1), path)
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    return path


MACRO_FRAME = Codec().encode(AddMacroRequest(1, "", (MacroCommand(1),)))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"byte_order": "big"}, "was saved by a big-endian board; use --byte-order big"),
        ({"byte_order": "middle"}, r"byte_order"),
        ({"battery": 1001}, r"battery"),
        ({"angles": {"1": 181}}, r"angles"),
        ({"surprise": 1}, r"surprise"),
        ({"requests": ["zz"]}, r"requests\[0\]: non-hexadecimal"),
        ({"requests": [MACRO_FRAME.hex(), MACRO_FRAME[:-1].hex()]}, r"requests\[1\]: .*bytes"),
        ({"requests": [Codec().encode(ExecuteMacroRequest(1)).hex()]}, "ExecuteMacroRequest stores nothing"),
        (
            {"requests": [Codec().encode(SetActiveJoystickTableRequest(3)).hex()]},
            "SetActiveJoystickTableRequest needs",
        ),
        ({"requests": [Codec().encode(AddServoParameterRequest((ServoParameter(2),))).hex()]}, "more memory or servos"),
    ],
)
def test_bad_files_are_refused_with_the_reason(tmp_path: Path, changes: dict[str, object], text: str) -> None:
    path = _saved(tmp_path, **changes)
    board = VirtualBoard(servos=1)
    board.storage.project_id = 5
    with pytest.raises(ServolinkError, match=text) as caught:
        load_state(board, path)
    assert str(path) in str(caught.value)
    assert board.storage.project_id == 5


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"{", b"[]", b'{"byte_order": "little"}', b'{"schema": 1}'])
def test_what_is_no_state_is_refused_and_not_to_be_deleted(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "board.json"
    path.write_bytes(content)
    with pytest.raises(ServolinkError, match=r"is not a saved board: .*; give another file \(`servolink apply`"):
        load_state(VirtualBoard(), path)


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ServolinkError, match="cannot be read"):
        load_state(VirtualBoard(), tmp_path)


def test_what_is_no_file_is_refused_without_waiting_for_it() -> None:
    with pytest.raises(ServolinkError, match=r"cannot be read: .*not a regular file"):
        load_state(VirtualBoard(), Path(os.devnull))


def test_a_file_larger_than_any_state_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    with path.open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(ServolinkError, match=r"board\.json: cannot be read: is larger than 4,848,576 bytes"):
        load_state(VirtualBoard(kind=BoardKind(memory=950_000)), path)


def test_a_file_that_could_not_be_saved_is_refused_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(ServolinkError, match="the folder does not exist; create it first"):
        load_state(VirtualBoard(), tmp_path / "nowhere" / "board.json")


def test_a_board_with_less_memory_refuses_what_does_not_fit(board: VirtualBoard, tmp_path: Path) -> None:
    path = tmp_path / "board.json"
    save_state(board, path)
    with pytest.raises(ServolinkError, match="needs more memory"):
        load_state(VirtualBoard(servos=3, codec=board.codec, kind=BoardKind(memory=50)), path)


@pytest.mark.parametrize("on_duplicate", get_args(OnDuplicate))
def test_doubles_and_torn_records_come_back_whatever_the_board_does_with_such(
    on_duplicate: OnDuplicate, tmp_path: Path
) -> None:
    path = tmp_path / "board.json"
    host = Host(VirtualBoard(servos=1, kind=BoardKind(on_duplicate="append")))
    for degree in (1, 2):
        host.store_action(7, (1, degree, 3))
        host.ask(AddJoystickTableRequest(degree, "pad"))
    host.ask(AddJoystickTableRequest(1, "another"))
    host.store_macro(2, MacroCommand(7))
    host.store_macro(2, MacroCommand(7), MacroCommand(7))
    host.ask(SetActiveJoystickTableRequest(2))
    storage = host.board.storage
    macro = storage.get(MACRO, 2) or b""
    storage.put(MACRO, {2: macro[:40] + b"\xff" * 10})
    storage.delete(TABLE, 2)
    storage.contents = replace(storage.contents, chosen_table=2)  # as a deletion that was torn may leave it
    save_state(host.board, path)
    loaded = VirtualBoard(servos=1, kind=BoardKind(on_duplicate=on_duplicate))
    for _ in range(2):  # again, it takes the place of what is there
        load_state(loaded, path)
        assert loaded.storage.contents == replace(storage.contents, chosen_table=0)
    assert loaded.powered
