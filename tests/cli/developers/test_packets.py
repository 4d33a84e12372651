"""`servolink decode` and `servolink encode`, as a shell and as other programs use them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink.__main__ import main
from servolink.protocol import HEADER, MAGIC, encode_frame
from tests import processes

DATA = Path(__file__).parents[2] / "data"
VECTORS: list[dict[str, Any]] = json.loads((DATA / "vectors.json").read_text())

ASK = "134c051d344e0100070b"
ASKED = {"packet": "QueryServoRequest", "id": 20020, "fields": {"servo_id": 7}}
LYING = encode_frame(20050, b"\x02" + bytes(5), "little")

Stdin = Callable[[bytes], None]
Capture = pytest.CaptureFixture[str]


@pytest.fixture
def stdin(tmp_path: Path) -> Iterator[Stdin]:
    """Put bytes on the real standard input."""
    kept = os.dup(0)

    def put(data: bytes) -> None:
        path = tmp_path / "stdin"
        path.write_bytes(data)
        source = os.open(path, os.O_RDONLY)
        os.dup2(source, 0)
        os.close(source)

    yield put
    os.dup2(kept, 0)
    os.close(kept)


def objects(capsys: Capture) -> list[dict[str, Any]]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def shell(*arguments: str, typed: str = "", **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "servolink", *arguments]
    return processes.run(command, typed, env={**os.environ, **environment})


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_all_golden_frames_go_through_the_shell_and_back(byte_order: str) -> None:
    frames = [vector["frame"] for vector in VECTORS if vector["byte_order"] == byte_order]
    decoded = shell("decode", "--json", "--byte-order", byte_order, "--hex", "-", typed="\n".join(frames))
    assert (decoded.returncode, decoded.stderr) == (0, "")
    names = [json.loads(line)["packet"] for line in decoded.stdout.splitlines()]
    assert names == [vector["name"] for vector in VECTORS if vector["byte_order"] == byte_order]
    encoded = shell("encode", "--byte-order", byte_order, typed=decoded.stdout)
    assert (encoded.returncode, encoded.stderr) == (0, "")
    assert encoded.stdout.split() == frames


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_all_golden_frames_are_found_in_a_stream(byte_order: str, tmp_path: Path, capsys: Capture) -> None:
    chosen = [vector for vector in VECTORS if vector["byte_order"] == byte_order]
    capture = tmp_path / "capture.bin"
    capture.write_bytes(b"".join(bytes.fromhex(vector["frame"]) for vector in chosen))
    assert main(["--byte-order", byte_order, "decode", "--json", "--file", str(capture)]) == 0
    assert [found["id"] for found in objects(capsys)] == [vector["id"] for vector in chosen]


@pytest.mark.parametrize(
    "arguments",
    [
        [ASK],
        ["13 4c 05 1d 34 4e 01 00 07 0b"],
        ["13:4C:05:1D:34:4E:01:00:07:0B"],
        ["13", "4c", "05", "1d", "34", "4e", "01", "00", "07", "0b"],
    ],
)
def test_a_frame_may_be_written_in_many_ways(arguments: list[str], capsys: Capture) -> None:
    assert main(["decode", "--json", *arguments]) == 0
    assert objects(capsys) == [ASKED]


def test_each_argument_is_a_frame_and_what_is_none_is_said_in_its_place(capsys: Capture) -> None:
    assert main(["decode", "--json", ASK, "134c051d", "hello", ASK[:-2] + "0c", LYING.hex(), ASK]) == 1
    found = objects(capsys)
    assert found[0] == found[-1] == ASKED
    assert [entry.get("bytes") for entry in found[1:-1]] == ["134c051d", "", ASK[:-2] + "0c", LYING.hex()]
    assert found[1]["error"] == "4 bytes are fewer than the 9 of the shortest frame"
    assert found[2]["error"] == "must be hex digits in pairs, not 'hello'"
    assert found[3]["error"] == "the checksum is 0x0c, but the bytes sum to 0x0b"
    assert found[4]["error"] == "ExecuteActionRequest: 2 steps take 11 bytes, the content has 6"


def test_hex_lines_come_from_a_file_too_and_blank_ones_are_nothing(tmp_path: Path, capsys: Capture) -> None:
    lines = tmp_path / "frames.txt"
    lines.write_bytes(f"\n{ASK}\r\n   \n\t{ASK}".encode() + b"\n\xff\xfe\x00\n" + ASK.encode())
    assert main(["decode", "--json", "--hex", str(lines)]) == 1
    found = objects(capsys)
    assert found[:2] + found[3:] == [ASKED] * 3
    assert found[2] == {"error": "must be hex digits in pairs, not '\\xff\\xfe\\x00'", "bytes": ""}


def test_a_stream_shows_frames_and_all_that_lies_between(stdin: Stdin, capsys: Capture) -> None:
    ask = bytes.fromhex(ASK)
    damaged = ask[:-1] + b"\x0c"
    stdin(b"noise" + MAGIC + b"\x01" + ask + ask + bytes(54) + LYING + damaged + ask[:6])
    assert main(["decode", "--json", "--file", "-"]) == 1
    assert objects(capsys) == [
        {"skipped": 10, "bytes": (b"noise" + MAGIC + b"\x01").hex()},
        ASKED,
        ASKED,
        {"skipped": 54, "bytes": bytes(54).hex()},
        {"error": "ExecuteActionRequest: 2 steps take 11 bytes, the content has 6", "bytes": LYING.hex()},
        {"skipped": 16, "bytes": (damaged + ask[:6]).hex()},
    ]


def test_a_long_skipped_span_comes_in_pieces_of_64_kib(stdin: Stdin, capsys: Capture) -> None:
    stdin(b"\x01" * 150_000 + bytes.fromhex(ASK))
    assert main(["decode", "--json", "--file", "-"]) == 1
    assert [found.get("skipped") for found in objects(capsys)] == [65_536, 65_536, 18_928, None]


def test_the_empty_stream_is_no_error(stdin: Stdin, capsys: Capture) -> None:
    stdin(b"")
    assert main(["decode", "--json", "--file", "-"]) == 0
    stdin(b"")
    assert main(["encode"]) == 0
    assert capsys.readouterr().out == ""


def test_a_live_stream_comes_out_as_it_arrives() -> None:
    command = [sys.executable, "-m", "servolink", "decode", "--json", "--file", "-"]
    process = processes.start(command, stdin=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stdout is not None
    for half in (ASK[: 9 * 2], ASK[9 * 2 :] + ASK):
        process.stdin.write(bytes.fromhex(half).decode(errors="surrogateescape"))
        process.stdin.flush()
    assert json.loads(process.stdout.readline()) == ASKED
    assert json.loads(process.stdout.readline()) == ASKED
    assert processes.finish(process) == ("", "")
    assert process.returncode == 0


def test_captions_in_any_encoding_survive_json(capsys: Capture) -> None:
    quote = {
        "packet": "AddActionRequest",
        "id": 30030,
        "fields": {"action_id": 1, "action_caption": "揮手", "steps": []},
    }
    assert main(["encode", "--caption-encoding", "big5", json.dumps(quote)]) == 0
    frame = capsys.readouterr().out.strip()
    assert "揮手".encode("big5").hex() in frame
    assert main(["decode", "--json", "--caption-encoding", "big5", frame]) == 0
    assert objects(capsys) == [quote]
    assert main(["decode", "--json", frame]) == 0  # as UTF-8 it is no text: the bytes are kept
    line = capsys.readouterr().out
    assert line.isascii()
    assert main(["encode", line]) == 0
    assert capsys.readouterr().out.strip() == frame


def test_text_for_people_is_a_line_for_each_packet_and_record(capsys: Capture) -> None:
    described = {"action_id": 4, "action_caption": "go", "steps": [{"servo_id": 1, "degree": -9, "interval": 50}] * 2}
    assert main(["encode", json.dumps({"id": 30030, "fields": described})]) == 0
    assert main(["decode", capsys.readouterr().out.strip(), ASK, "13"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "AddActionRequest (30030) action_id=4 action_caption='go' steps: 2",
        "    servo_id=1 degree=-9 interval=50",
        "    servo_id=1 degree=-9 interval=50",
        "QueryServoRequest (20020) servo_id=7",
        "error: 1 bytes are fewer than the 9 of the shortest frame  13",
    ]


def test_text_for_people_holds_nothing_that_steers_a_terminal(stdin: Stdin, capsys: Capture) -> None:
    content = (1).to_bytes(4, "little") + b"\x1b]0;owned\x07\xff".ljust(32, b"\0") + bytes(2)
    stdin(encode_frame(30021, content, "little") + b"\x1b[2J" * 20)
    assert main(["decode", "--file", "-"]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert first == "QueryActionResponse (30021) action_id=1 action_caption='\\x1b]0;owned\\x07\\xff' steps=()"
    assert second == "skipped 80 bytes  " + (b"\x1b[2J" * 8).hex() + "... (80 bytes)"
    assert main(["decode", "\x1b[2J\u202e"]) == 1
    assert capsys.readouterr().out == "error: must be hex digits in pairs, not '\\x1b[2J\\u202e'\n"


def test_errors_of_encode_name_the_field_and_the_other_lines_are_done(stdin: Stdin, capsys: Capture) -> None:
    bad = {"id": 20050, "fields": {"steps": [{"servo_id": 300, "degree": 0, "interval": 0}]}}
    lines = f"{json.dumps(ASKED)}\n\n{json.dumps(bad)}\n{json.dumps(ASKED)}".encode()
    fault = "ExecuteActionRequest.steps[0].servo_id: 300 is outside 0..255"
    stdin(lines)
    assert main(["encode"]) == 1
    out, err = capsys.readouterr()
    assert out.split() == [ASK, ASK]
    assert err == f"servolink: line 3: {fault}\n"
    stdin(lines)
    assert main(["encode", "--json"]) == 1
    assert objects(capsys) == [{"bytes": ASK}, {"error": fault}, {"bytes": ASK}]


STEP = b'{"servo_id": 1, "degree": 0, "interval": 0}'

HOSTILE = [
    (b"\xff\xfe\x00", "is not text in UTF-8 (byte 0)"),
    (b'{"id": 20020, "fields": {"servo_id": 7}}\x00', "is not JSON"),
    (b"[" * 100_000, "nested too deeply"),
    (b'{"a":' * 100_000, "nested too deeply"),
    (b'{"id": 20020, "fields": {"servo_id": NaN}}', "NaN is not a number"),
    (b'{"id": 20020, "fields": {"servo_id": -Infinity}}', "-Infinity is not a number"),
    (b'{"id": 20020, "fields": {"servo_id": 1e400}}', "QueryServoRequest.servo_id: must be an integer, not Infinity"),
    (b'{"id": 20020, "fields": {"servo_id": 1' + b"0" * 50 + b"}}", "is outside 0..255"),
    (b'{"id": 20020, "fields": {"servo_id": 1' + b"0" * 5000 + b"}}", "contains an integer of thousands of digits"),
    (b'{"id": 20020, "id": 20020, "fields": {"servo_id": 7}}', "'id' is a duplicate key"),
    (b'{"id": 20020, "fields": {"servo_id": 7, "servo_id": 8}}', "fields: 'servo_id' is a duplicate key"),
    (b'{"id": 20020, "fields": {"\\u001b[2J": 7}}', "QueryServoRequest.\\x1b[2J: no such field"),
    (b'{"id": 20050, "fields": {"steps": [{"\\udcff": 1}]}}', "steps[0]: '\ufffd' is not a field"),
    (b'{"id": 20050, "fields": {"steps": [' + b",".join([STEP] * 256) + b"]}}", "256 records are outside 0..255"),
    (b'{"id": 30030, "fields": {"action_id": 1, "action_caption": "\\ud800"}}', "cannot be written in utf-8"),
    (b'{"id": 30030, "fields": {"action_id": 1, "action_caption": "\\u0000"}}', "holds control characters"),
    (b'{"packet": "' + b"x" * (1 << 22) + b'"}', "longer than 4,194,304 bytes"),
    (b'{"packet": "' + b"x" * 100_000 + b'"}', "packet: there is no 'xxx"),
    (b"'single'", "is not JSON"),
    (b'{"error": "no frame", "bytes": ""}', "the object has neither packet nor id"),
]


def test_hostile_lines_are_one_error_each_and_never_a_traceback() -> None:
    lines = b"\n".join([line for bad, _ in HOSTILE for line in (bad, json.dumps(ASKED).encode())])
    done = shell("encode", "--json", typed=lines.decode(errors="surrogateescape"))
    assert (done.returncode, done.stderr) == (1, "")
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert found[1::2] == [{"bytes": ASK}] * len(HOSTILE)
    for (line, fault), quote in zip(HOSTILE, found[::2], strict=True):
        assert fault in quote["error"], line[:60]
        assert len(quote["error"]) < 400


@pytest.mark.parametrize(("line", "fault"), [case for case in HOSTILE if b"\xff" not in case[0]])
def test_hostile_objects_are_errors_for_people_too(line: bytes, fault: str, capsys: Capture) -> None:
    assert main(["encode", line.decode()]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("servolink: object 1: ")
    assert fault in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["decode"], "one of the arguments HEX --hex --file is required"),
        (["decode", ASK, "--file", "x"], "not allowed with"),
        (["decode", "--hex", "x", "--file", "x"], "not allowed with"),
        (["decode", ASK, "--byte-order", "middle"], "must be little or big, not 'middle'"),
        (["decode", ASK, "--caption-encoding", "klingon"], "caption encoding 'klingon' cannot be used"),
        (["encode", "{}", "--caption-encoding", "utf-16"], "choose one such as utf-8, big5 or utf-16-le"),
    ],
)
def test_wrong_usage_is_exit_code_2(arguments: list[str], fault: str, capsys: Capture) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert fault in capsys.readouterr().err


def test_a_file_that_is_not_there_is_said(tmp_path: Path, capsys: Capture) -> None:
    assert main(["decode", "--file", str(tmp_path / "none.bin")]) == 1
    assert "No such file or directory" in capsys.readouterr().err


def test_a_huge_false_claim_at_the_end_of_a_stream_is_searched(stdin: Stdin, capsys: Capture) -> None:
    stdin(HEADER["little"].pack(MAGIC, 10050, 60_000) + bytes.fromhex(ASK))
    assert main(["decode", "--json", "--file", "-"]) == 1
    assert objects(capsys) == [{"skipped": 8, "bytes": "134c051d4227 60ea".replace(" ", "")}, ASKED]
