"""`servolink.recorder.open_recording`: typed messages and tables of a recording."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any, assert_type

import pytest

import servolink
from servolink import RecordingError
from servolink.recorder.channels import (
    CHANNELS,
    CommandDone,
    Event,
    PacketSeen,
    RecordedServo,
    ServosRead,
    Wire,
    columns,
)
from servolink.recorder.reading import Recording, Selection
from servolink.testing import FakeBoard, run
from tests import processes
from tests.recorder.files import START, write

KINDS = list(CHANNELS.values())
LIBRARIES = ("numpy", "pandas")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording by the real recorder: two readings of three servos, a movement and a mark."""
    file = tmp_path_factory.mktemp("recording") / "out.mcap"

    async def main() -> None:
        async with FakeBoard(servos=3).connect() as board, servolink.recorder.record(file, board, hz=20) as recorder:
            await board.move({1: 60, 2: -30}, duration=0.5, wait=True)
            recorder.mark("it stands")
            await board.add_action(servolink.Action.pose("wave", {2: 10}, seconds=1.0))

    run(main())
    return file


def test_messages_of_a_kind_have_its_type(path: Path) -> None:
    recording = servolink.recorder.open_recording(path)
    entry = next(iter(recording.messages(CommandDone, packet="ExecuteAction")))
    assert_type(entry.message, CommandDone)
    assert entry.message.outcome == "sent"
    assert recording.about is not None
    assert recording.about.board.startswith("virtual://fake-")
    assert [each.message.what for each in recording.messages(Event) if each.message.kind == "mark"] == ["it stands"]


@pytest.mark.parametrize("kind", KINDS)
def test_messages_are_those_that_the_commands_read(path: Path, kind: type) -> None:
    recording = servolink.recorder.open_recording(str(path))
    assert list(recording.messages(kind)) == [each for each in recording.entries() if type(each.message) is kind]


def test_messages_are_selected_by_time_and_problem(path: Path) -> None:
    recording = servolink.recorder.open_recording(path)
    assert (
        {entry.seconds for entry in recording.messages(Wire, since=0.2, until=0.4)}
        == {entry.seconds for entry in recording.messages(Wire) if 0.2 <= entry.seconds <= 0.4}
        != set()
    )
    assert list(recording.messages(CommandDone, only_problems=True)) == []


def test_readings_of_a_servo_have_its_state_only(path: Path) -> None:
    recording = servolink.recorder.open_recording(path)
    all_angles = [entry.message.servos[1].angle for entry in recording.messages(ServosRead)]
    states = [entry.message.servos for entry in recording.messages(ServosRead, servo_id=2)]
    assert {tuple(state.servo_id for state in each) for each in states} == {(2,)}
    assert [each[0].angle for each in states] == all_angles
    assert -30 in all_angles
    assert list(recording.messages(ServosRead, servo_id=9)) == []
    assert {entry.message.packet for entry in recording.messages(CommandDone, servo_id=2)} >= {"AddActionRequest"}


def test_messages_are_read_again_in_each_loop_and_in_loops_within_loops(path: Path) -> None:
    readings = servolink.recorder.open_recording(path).messages(ServosRead)
    assert len([(one.time, other.time) for one in readings for other in readings]) == len(list(readings)) ** 2 > 4


def test_what_is_no_kind_of_message_is_refused(path: Path) -> None:
    with pytest.raises(TypeError, match=r"kind must be a class of messages \(Wire, .*\), not .*RecordedServo"):
        servolink.recorder.open_recording(path).messages(RecordedServo)  # type: ignore[type-var]


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot read the recording"):
        servolink.recorder.open_recording(tmp_path / "none.mcap")
    (tmp_path / "x").write_text("{}")
    with pytest.raises(RecordingError, match="is not an MCAP file"):
        servolink.recorder.open_recording(str(tmp_path / "x"))


def test_what_a_cut_file_lacks_is_reported(path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-3000])
    recording = servolink.recorder.open_recording(cut)
    whole = list(servolink.recorder.open_recording(path).entries())
    found = list(recording.entries())
    assert found == whole[: len(found)]
    assert len(found) > 0
    assert "the file is cut" in recording.remarks[-1]


def test_what_a_damaged_file_lacks_is_reported_by_each_reading(tmp_path: Path) -> None:
    events = [(seconds / 10, Event("mark", f"mark {seconds}")) for seconds in range(100)]
    path = write(tmp_path / "out.mcap", events, chunk_size=500)
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 3] ^= 0xFF
    path.write_bytes(damaged)
    recording = servolink.recorder.open_recording(path)
    for _ in range(2):
        assert 0 < len(list(recording.messages(Event))) < 100
        assert any("left out" in remark for remark in recording.remarks)


def test_a_structured_array_has_the_columns_and_rows_of_convert(path: Path, tmp_path: Path) -> None:
    numpy = pytest.importorskip("numpy")
    recording = servolink.recorder.open_recording(path)
    table = recording.messages(ServosRead).to_numpy()
    assert servolink_convert(path, tmp_path)[0] == list(table.dtype.names) == list(columns(ServosRead))
    rows = servolink_convert(path, tmp_path)[1:]
    assert [[row[0], row[1], float(row[3])] for row in rows] == [
        [f"{row['seconds']:.6f}", str(row["time_ns"]), row["angle"]] for row in table
    ]
    assert table["angle"].dtype == table["seconds"].dtype == numpy.float64
    assert table["servo_id"].dtype == table["time_ns"].dtype == numpy.int64
    assert table["is_hold"].dtype == numpy.bool_
    of_servo = recording.messages(ServosRead, servo_id=1, since=0.1).to_numpy()
    assert (numpy.diff(of_servo["angle"]) >= 0).all()
    assert of_servo["angle"][-1] == 60


def servolink_convert(path: Path, folder: Path) -> list[list[str]]:
    """Return the rows that `servolink convert` writes of the readings."""
    from servolink.__main__ import main

    out = folder / "servos.csv"
    assert main(["convert", str(path), "--csv", "--channel", "servos", "-o", str(out), "--force"]) == 0
    return list(csv.reader(out.read_text().splitlines()))


@pytest.mark.parametrize("kind", KINDS)
def test_there_is_a_table_for_each_kind(path: Path, kind: type[Any]) -> None:
    pytest.importorskip("numpy")
    recording = servolink.recorder.open_recording(path)
    messages = recording.messages(kind)
    table = messages.to_numpy()
    assert list(table.dtype.names) == list(columns(kind))
    expected = sum(len(entry.message.servos) if kind is ServosRead else 1 for entry in messages)
    assert len(table) == expected


def test_pandas_has_numbers_texts_and_fields(path: Path) -> None:
    pytest.importorskip("pandas")
    recording = servolink.recorder.open_recording(path)
    angles = recording.messages(ServosRead).to_pandas().pivot_table("angle", "seconds", "servo_id")
    assert list(angles.columns) == [1, 2, 3]
    assert angles[1].max() == 60
    commands = recording.messages(CommandDone).to_pandas()
    assert set(commands.outcome) == {"answered", "sent"}
    (moved,) = commands[commands.packet == "ExecuteActionRequest"].fields
    assert moved["steps"][0] == {"servo_id": 1, "degree": 60, "interval": 50}


def test_a_number_beyond_64_bits_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("numpy")
    path = write(tmp_path / "out.mcap", [(0.0, PacketSeen("sent", 2**64 - 1))])
    assert len(list(servolink.recorder.open_recording(path).messages(PacketSeen))) == 1
    with pytest.raises(RecordingError, match=r"out\.mcap: a number is too large for a table"):
        servolink.recorder.open_recording(path).messages(PacketSeen).to_numpy()


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str) -> None:
    messages = Recording(write(tmp_path / "out.mcap", [])).messages(Event)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(RecordingError, match=f"needs {library}, which is not installed; run: pip install {library}"):
        getattr(messages, f"to_{library}")()


def test_a_recording_is_read_without_heavy_libraries_and_servolink_imported_without_the_recorder(path: Path) -> None:
    program = (
        "import sys, servolink; assert 'servolink.recorder' not in sys.modules\n"
        f"print(len(list(servolink.recorder.open_recording({str(path)!r}).entries())))\n"
        f"sys.exit(bool({{*{LIBRARIES!r}, 'mcap'}} & sys.modules.keys()))"
    )
    said = processes.run((sys.executable, "-c", program), check=True)
    assert int(said.stdout) == len(list(Recording(path).entries(Selection())))
    assert Recording(path).started > START
