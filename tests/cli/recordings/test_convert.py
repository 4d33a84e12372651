"""`servolink convert` writes tables that a spreadsheet reads without obeying them, and captures."""

from __future__ import annotations

import csv
import errno
import os
import sys
from pathlib import Path
from typing import NoReturn

import pytest

from servolink.protocol import Codec, QueryServoListRequest
from servolink.recorder import MAGIC, Event, Message, Wire
from tests import processes
from tests.cli.programs import call
from tests.recorder.files import START, write
from tests.recorder.test_pcapng import blocks, read_back
from tests.recorder.test_reading import MESSAGES


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write(tmp_path / "out.mcap", MESSAGES)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_each_channel_has_a_table(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "convert", str(recording), "--csv", "--json")
    names = ("wire", "packets", "commands", "servos", "events", "problems")
    assert {Path(path).name for path in said.json["files"]} == {f"out.{name}.csv" for name in names}
    (servo,) = table(recording.with_name("out.servos.csv"))
    assert servo == {
        "seconds": "1.000000",
        "time_ns": "1700000001000000000",
        "servo_id": "3",
        "angle": "90.0",
        "angle_unit": "degree",
        "current_raw": "5",
        "temperature_raw": "300",
        "servo_type": "1",
        "is_start": "1",
        "is_hold": "1",
        "doubt": "",
        "missed": "0",
    }
    assert [row["data"] for row in table(recording.with_name("out.wire.csv"))] == ["134c"]
    first, second = table(recording.with_name("out.commands.csv"))
    assert (first["fields"], first["outcome"]) == ('{"servo_id": 3, "unit_type": 0}', "answered")
    assert (second["took_seconds"], second["who"]) == ("3.0", "")


def test_one_channel_in_a_part_of_the_time(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = recording.with_name("x.csv")
    said = call(capsys, "convert", str(recording), "--csv", "--channel", "commands", "--to", "0.75", "-o", str(out))
    assert said.out == f"{out}  1 row\n"
    assert len(table(out)) == 1


@pytest.mark.parametrize(("form", "ending"), [("--csv", ".wire.csv"), ("--pcap", ".pcapng")])
def test_names_with_dots_stay_apart(form: str, ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("2024.01.02", "2024.01.03", "2024.01.04.mcap", "2024.01.05.MCAP", ".mcap")
    for name in names:
        write(tmp_path / name, [(0.0, Wire("sent", b"x", 0.0))])
        assert call(capsys, "convert", str(tmp_path / name), form).code == 0
    written = {path.name for path in tmp_path.iterdir()} - set(names)
    assert written == {f"{name}{ending}" for name in ("2024.01.02", "2024.01.03", "2024.01.04", "2024.01.05", ".mcap")}


def test_existing_file_is_kept(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = recording.with_name("out.events.csv")
    out.write_text("precious")
    said = call(capsys, "convert", str(recording), "--csv")
    assert said.code == 1
    assert "out.events.csv exists already; --force replaces it" in said.err
    assert [path.name for path in recording.parent.iterdir() if path.suffix == ".csv"] == ["out.events.csv"]
    assert out.read_text() == "precious"
    assert call(capsys, "convert", str(recording), "--csv", "--force").code == 0


@pytest.mark.parametrize(
    ("options", "out"),
    [
        (("--csv", "--channel", "wire"), "wire.mcap"),
        (("--csv", "--channel", "wire"), "link.mcap"),
        (("--csv",), "x.mcap"),  # to which the name of the channel is added
        (("--csv",), "none/../x.mcap"),
        (("--pcap",), "wire.mcap"),
        (("--pcap",), "link.mcap"),
    ],
)
def test_the_recording_is_never_replaced(
    options: tuple[str, ...], out: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / "x.wire.mcap", MESSAGES)
    content = path.read_bytes()
    (tmp_path / "none").mkdir()
    os.link(path, tmp_path / "wire.mcap")
    os.link(path, tmp_path / "link.mcap")
    said = call(capsys, "convert", str(path), *options, "-o", str(tmp_path / out), "--force")
    assert said.code == 2
    assert "is the file that is read, and would be lost; choose another name with --output" in said.err
    assert path.read_bytes() == content
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.skipif(sys.platform == "win32", reason="links need a privilege there")
def test_the_target_of_a_linked_recording_is_not_replaced(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link = recording.with_name("link.mcap")
    link.symlink_to(recording)
    for source, out in ((link, recording), (recording, link)):
        assert call(capsys, "convert", str(source), "--pcap", "-o", str(out), "--force").code == 2
    assert recording.read_bytes().startswith(MAGIC)


def test_texts_are_no_formulas(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texts = ["=1+1", "+1", "-1", "@x", "\t=1", "'", "\x1b[2J", "plain"]
    path = write(tmp_path / "out.mcap", [(0.0, Event("mark", "mark", text=text)) for text in texts])
    call(capsys, "convert", str(path), "--csv")
    found = [row["text"] for row in table(tmp_path / "out.events.csv")]
    assert found == ["'=1+1", "'+1", "'-1", "'@x", "\\x09=1", "''", "\\x1b[2J", "plain"]


def test_nothing_to_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "convert", str(write(tmp_path / "out.mcap", [])), "--csv")
    assert (said.code, said.out) == (0, "nothing was written: the recording holds nothing of this kind\n")


@pytest.mark.parametrize("place", ["none/x.csv", "nul\0.csv"])
def test_file_that_cannot_be_written(place: str, recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "convert", str(recording), "--csv", "-o", str(recording.parent / place))
    assert said.code == 1
    assert "csv cannot be written: " in said.err


def test_the_wire_is_a_capture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = Codec("big").encode(QueryServoListRequest())
    wire = [(0.0, Wire("sent", asked[:3], 0.0)), (0.5, Wire("sent", asked[3:], 0.5)), (9.0, Wire("sent", asked, 9.0))]
    about = {"version": "1", "started": "now", "board": "rex\x1b[2J", "through": "board", "byte_order": "big"}
    path, out = write(tmp_path / "out.mcap", wire, about=about), tmp_path / "out.pcapng"
    assert call(capsys, "convert", str(path), "--pcap", "--to", "1").out == f"{out}  1 packet\n"
    assert read_back(out.read_bytes()) == [(START + 500_000_000, "sent", asked)]
    assert b"rex\\x1b[2J, byte order big" in next(blocks(out.read_bytes())).options[1]
    assert "exists already; --force replaces it" in call(capsys, "convert", str(path), "--pcap").err
    said = call(capsys, "convert", str(path), "--pcap", "--force", "--json")
    assert said.json == {"files": {str(out): 2}, "remarks": []}
    assert call(capsys, "convert", str(path), "--pcap", "--servo", "3").code == 2


def test_a_capture_that_cannot_be_written(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "convert", str(recording), "--pcap", "-o", str(recording.parent / "none/x.pcapng"))
    assert said.code == 1
    assert "x.pcapng cannot be written: the folder does not exist; create it first" in said.err


FORMS = pytest.mark.parametrize("form", [("--csv", "--channel", "events"), ("--pcap",)], ids=["csv", "pcap"])
NOISE = Wire("sent", b"x" * 99, 0.0)
MANY: list[tuple[float, Message]] = [
    each for at in range(500) for each in ((float(at), Event("mark", "mark", "x" * 99)), (at + 0.5, NOISE))
]


def full(*_: object) -> NoReturn:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@FORMS
@pytest.mark.parametrize("before", [b"precious", None])
def test_on_a_full_disk_what_was_there_stays(
    form: tuple[str, ...],
    before: bytes | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, out = write(tmp_path / "out.mcap", MANY), tmp_path / "x"
    if before is not None:
        out.write_bytes(before)
    monkeypatch.setattr(os, "fsync", full)
    said = call(capsys, "convert", str(path), *form, "-o", str(out), "--force")
    assert (said.code, said.err) == (1, f"servolink: {out} cannot be written: {os.strerror(errno.ENOSPC)}\n")
    assert (out.read_bytes() if out.exists() else None) == before
    assert {each.name for each in tmp_path.iterdir()} == {"out.mcap", "x"} - ({"x"} if before is None else set())


# No compiled module is written: Python does not see that a file was cut by the limit. The limit is lifted at the end:
# where coverage is measured, the program writes down then what it has run.
_WITH_A_LIMIT = """
import resource, sys
sys.dont_write_bytecode = True
from servolink.__main__ import main
before = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (9000, before[1]))
try:
    code = main(sys.argv[1:])
finally:
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
sys.exit(code)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="links and limits of POSIX")
@FORMS
def test_a_link_outlives_a_file_that_may_not_grow(form: tuple[str, ...], tmp_path: Path) -> None:
    path, out, target = write(tmp_path / "out.mcap", MANY), tmp_path / "x", tmp_path / "target"
    target.write_text("precious")
    out.symlink_to(target)
    line = [sys.executable, "-c", _WITH_A_LIMIT, "convert", str(path), *form, "-o", str(out), "--force"]
    said = processes.run(line)
    assert (said.returncode, said.stderr) == (1, f"servolink: {out} cannot be written: {os.strerror(errno.EFBIG)}\n")
    assert out.readlink() == target
    assert target.read_text() == "precious"


@pytest.mark.skipif(sys.platform == "win32", reason="a pipe of POSIX")
@FORMS
def test_a_pipe_is_left_alone(form: tuple[str, ...], recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe = recording.with_name("pipe")
    os.mkfifo(pipe)
    said = call(capsys, "convert", str(recording), *form, "-o", str(pipe), "--force")
    assert said.code == 1
    assert said.err == f"servolink: {pipe} is not a regular file, and stays unchanged; choose another name\n"
    assert pipe.is_fifo()
