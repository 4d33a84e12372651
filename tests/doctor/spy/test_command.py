"""`servolink spy`, with a board and a program on real pseudo-terminals.

Modules: servolink.cli.developers.spy, servolink.doctor.spy.watching, servolink.recorder.late_recording.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from servolink.protocol import Codec, QueryServoListRequest, QueryServoListResponse, encode_frame
from servolink.recorder import Event, Recording, Wire
from tests.cli.programs import call
from tests.processes import until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")

CODEC = Codec("big")
ASKED = CODEC.encode(QueryServoListRequest())
SAID = CODEC.encode(QueryServoListResponse((1, 2, 3)))
LIMIT = 120.0


def exchange(program: int, board: int) -> None:
    """Have the program ask and the board answer, as raw bytes, and something unknown and hostile besides."""
    os.write(program, ASKED)
    assert read(board, len(ASKED)) == ASKED
    said = SAID + encode_frame(50021, b"\x1b[2J", "big")
    os.write(board, said)
    assert read(program, len(said)) == said


def read(port: int, count: int) -> bytes:
    """Read so many bytes, in however many pieces they come."""
    data = b""
    while len(data) < count:
        data += os.read(port, count - len(data))
    return data


@contextmanager
def board_that_vanishes(use: Callable[[int], None]) -> Iterator[str]:
    """Yield the port of a board that is used by a thread, and then pulled."""
    board, theirs = os.openpty()
    tty.setraw(theirs)
    failures: list[BaseException] = []

    def run() -> None:
        try:
            use(board)
        except BaseException as error:  # noqa: BLE001 - the test raises it
            failures.append(error)
        os.close(theirs)
        os.close(board)

    thread = threading.Thread(target=run)
    port = os.ttyname(theirs)
    thread.start()
    yield port
    thread.join(LIMIT)
    assert not failures


def test_it_shows_records_and_says_what_it_learnt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    link, file = tmp_path / "link", tmp_path / "out.mcap"

    def use(board: int) -> None:
        until(link.exists)
        program = os.open(link, os.O_RDWR | os.O_NOCTTY)
        exchange(program, board)
        until(file.exists)
        os.close(program)

    with board_that_vanishes(use) as port:
        said = call(capsys, "spy", port, "--pty", str(link), "--record", str(file))
    assert said.code == 3
    assert "the connection was lost" in said.err
    assert "a program has connected\nservolink: a program has gone" in said.err
    assert not link.is_symlink()
    first, *lines = said.out.splitlines()
    assert first == f"listening serial://{link}"
    unknown = encode_frame(50021, b"\x1b[2J", "big").hex()
    assert [line[9:] for line in lines[:3]] == [
        "  program  QueryServoListRequest (20010)",
        "  board    QueryServoListResponse (20011) servo_id_list=(1, 2, 3)",
        f"  board    unknown packet 50021 (big), 4 bytes: {unknown}",
    ]
    assert "byte order         big: so are all 1 of the board's packets" in lines
    assert any(
        line.startswith("unknown packets    50021 (big) from the board once, 4 bytes 1b5b324a") for line in lines
    )
    assert lines[-1].startswith("recorded ")
    recording = Recording(file)
    messages = [entry.message for entry in recording.entries()]
    assert recording.about is not None
    assert (recording.about.through, recording.about.byte_order) == ("spy", "big")
    assert (
        b"".join(message.data for message in messages if isinstance(message, Wire) and message.direction == "sent")
        == ASKED
    )
    (learnt,) = (message for message in messages if isinstance(message, Event) and message.kind == "recorder")
    assert "byte_order: big" in learnt.text


def test_objects_for_programs_over_tcp(capsys: pytest.CaptureFixture[str]) -> None:
    reserved = socket.socket()  # not listening: it keeps the port from anybody else but who reuses addresses, as spy
    reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    reserved.bind(("127.0.0.1", 0))
    host, number = reserved.getsockname()
    place = f"{host}:{number}"

    def use(board: int) -> None:
        connected: list[socket.socket] = []

        def connects() -> bool:
            try:
                connected.append(socket.create_connection((host, number)))
            except ConnectionRefusedError:
                return False
            return True

        until(connects)
        with connected[0] as connection:
            exchange(connection.fileno(), board)

    with reserved, board_that_vanishes(use) as port:
        said = call(capsys, "spy", port, "--tcp", place, "--json", "--baudrate", "57600")
    listening, asked, answered, unknown, last = said.objects
    assert listening == {"listening": f"tcp://{place}"}
    assert (asked["from"], asked["packet"], asked["byte_order"]) == ("program", "QueryServoListRequest", "big")
    assert answered["fields"] == {"servo_id_list": [1, 2, 3]}
    assert (unknown["kind"], unknown["id"]) == ("unknown", 50021)
    assert last["learnt"]["byte_order"] == "big"
    assert (last["overlooked"], last["recording"]) == (0, None)
    assert f"{listening['listening']} is open to every user of this machine" in said.err


def test_what_cannot_be_done_is_said_before_anything_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "old.mcap").touch()
    said = call(capsys, "spy", "/dev/nobody", "--record", str(tmp_path / "old.mcap"))
    assert "old.mcap exists already; remove it or record to another file" in said.err
    said = call(capsys, "spy", "/dev/nobody", "--record", str(tmp_path / "none/out.mcap"))
    assert "does not exist; create it first" in said.err
    said = call(capsys, "spy", "virtual://")
    assert (said.code, "is neither a serial port nor tcp://HOST:PORT" in said.err) == (2, True)
    assert "has none" in call(capsys, "spy", "tcp://127.0.0.1:9", "--baudrate", "9600").err
    said = call(capsys, "spy", "/dev/nobody", "--record", str(tmp_path / "new.mcap"))
    assert (said.code, said.out, "there is no /dev/nobody" in said.err) == (3, "", True)
    assert not (tmp_path / "new.mcap").exists()
