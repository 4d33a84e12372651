"""A session is recorded as it passes, and its recording stands for the board."""

from __future__ import annotations

import asyncio
import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.client import connect
from servolink.errors import ConnectionLost, OpenError
from servolink.transports.line_faults import Faults, FaultyTransport
from servolink.transports.line_recording import RecordingTransport, ReplayTransport
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from tests.transports.wires import Ear
from tests.virtual_time import run


def _lines(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_both_directions_are_recorded_with_times(tmp_path: Path) -> None:
    path = tmp_path / "session.jsonl"

    async def main() -> None:
        near, far = MemoryTransport.pair()
        transport, ear = RecordingTransport(near, path), Ear()
        await far.open(Ear())
        await asyncio.sleep(5)
        await transport.open(ear)
        await asyncio.sleep(0.25)
        await transport.send(b"\x13\x4c")
        await transport.send(b"")
        await asyncio.sleep(0.5)
        await far.send(b"\x05")
        await ear.hear(1)
        await far.close()
        await ear.end()
        await transport.close()

    run(main())
    *lines, last = _lines(path)
    assert lines == [{"t": 0.25, "sent": "134c"}, {"t": 0.75, "received": "05"}]
    assert last.keys() == {"t", "lost"}


def test_a_crash_loses_no_line_that_was_finished(tmp_path: Path) -> None:
    path = tmp_path / "session.jsonl"

    async def main() -> None:
        near, far = MemoryTransport.pair()
        transport = RecordingTransport(near, path)
        await far.open(Ear())
        await transport.open(Ear())
        await transport.send(b"\x01")
        assert _lines(path) == [{"t": 0.0, "sent": "01"}]  # while it still runs
        await transport.close()
        await far.close()

    run(main())
    assert len(_lines(path)) == 1, "an end that was asked for is no loss"


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "session.jsonl"
    path.write_text("precious")

    async def main() -> None:
        with pytest.raises(OpenError, match="exists already; remove the file or record to another file"):
            await RecordingTransport(MemoryTransport.pair()[0], path).open(Ear())

    run(main())
    assert path.read_text() == "precious"


@pytest.mark.parametrize("name", ["no/such/folder.jsonl", "nul\0.jsonl"])
async def test_a_file_that_cannot_be_made_is_told(tmp_path: Path, name: str) -> None:
    with pytest.raises(OpenError, match=r"cannot record to .*; choose another file"):
        await RecordingTransport(MemoryTransport.pair()[0], tmp_path / name).open(Ear())


def test_a_connection_that_cannot_be_opened_leaves_no_file(tmp_path: Path) -> None:
    async def main() -> None:
        with pytest.raises(OpenError):
            await RecordingTransport(create("/dev/servolink-nowhere"), tmp_path / "session.jsonl").open(Ear())

    asyncio.run(main())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device here that is always full")
@pytest.mark.parametrize("sends", [False, True])
async def test_a_full_disk_ends_the_connection_and_says_so(sends: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "open", lambda path, _, **options: open(path, "w", **options))  # noqa: SIM115
    near, far = MemoryTransport.pair()
    transport, ear, end = RecordingTransport(near, "/dev/full"), Ear(), Ear()
    await far.open(end)
    await transport.open(ear)
    if sends:
        with pytest.raises(ConnectionLost, match="cannot be written"):
            await transport.send(b"x")
    else:
        await far.send(b"x")
    error = await ear.end()
    assert isinstance(error, ConnectionLost)
    assert "/dev/full cannot be written" in str(error)
    await end.end()
    with pytest.raises(ConnectionLost, match="cannot be written"):
        await transport.send(b"y")
    await transport.close()
    assert len(ear.losses) == 1
    assert end.heard == b""


SESSION = [
    {"t": 1.0, "received": "aa"},
    {"t": 2.0, "sent": "0102"},
    {"t": 2.5, "received": "bb"},
    {"t": 3.0, "sent": "03"},
    {"t": 3.0, "sent": "04"},
    {"t": 3.25, "received": "cc"},
    {"t": 9.0, "lost": "unplugged"},
]


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = tmp_path / "session.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in SESSION))
    return path


async def test_what_was_received_comes_as_much_later_as_it_did(session: Path) -> None:
    loop = asyncio.get_running_loop()
    transport, ear = ReplayTransport(session), Ear()
    await transport.open(ear)
    start = loop.time()
    assert await ear.hear(1) == b"\xaa"
    assert loop.time() - start == pytest.approx(1.0)
    await asyncio.sleep(9)  # slower than the program that was recorded
    assert ear.heard == b"\xaa"
    await transport.send(b"\1\2")
    assert await ear.hear(2) == b"\xaa\xbb"
    assert loop.time() - start == pytest.approx(10.5)
    await transport.send(b"\3\4")
    assert await ear.hear(3) == b"\xaa\xbb\xcc"
    assert loop.time() - start == pytest.approx(10.75)
    assert "line 7: unplugged" in str(await ear.end())
    assert loop.time() - start == pytest.approx(16.5)
    with pytest.raises(ConnectionLost, match="unplugged"):
        await transport.send(b"\5")
    await transport.close()
    assert len(ear.losses) == 1


async def test_without_timing_it_comes_at_once_however_the_sends_are_cut(session: Path) -> None:
    loop = asyncio.get_running_loop()
    transport, ear = create(f"replay://{session}?timing=0"), Ear()
    start = loop.time()
    await transport.open(ear)
    await transport.send(b"\1")
    assert await ear.hear(1) == b"\xaa"
    await asyncio.sleep(0)
    assert ear.heard == b"\xaa"
    await transport.send(b"\2\3\4")
    assert await ear.hear(3) == b"\xaa\xbb\xcc"
    await ear.end()
    assert loop.time() == start


async def test_a_program_ahead_of_the_recording_still_hears_all_in_order(session: Path) -> None:
    transport, ear = ReplayTransport(session), Ear()
    await transport.open(ear)
    await transport.send(b"\1\2\3\4")
    await ear.end()
    assert ear.heard == b"\xaa\xbb\xcc"


@pytest.mark.parametrize(
    ("sends", "reason"),
    [
        ([b"\1\7"], "line 2: expected 02, got 07"),
        ([b"\1", b"\2\3\7"], "line 5: expected 04, got 07"),
        ([b"\1\2", b"\3\4\5"], "nothing more was sent in the recording, got 05"),
    ],
)
async def test_a_program_that_says_something_else_is_stopped_at_the_line(
    session: Path, sends: list[bytes], reason: str
) -> None:
    transport, ear = ReplayTransport(session), Ear()
    await transport.open(ear)
    *good, bad = sends
    for data in good:
        await transport.send(data)
    with pytest.raises(ConnectionLost, match="the program sent bytes different from the recording") as caught:
        await transport.send(bad)
    assert reason in str(caught.value)
    assert ear.losses == [caught.value]
    with pytest.raises(ConnectionLost, match="bytes different from the recording"):
        await transport.send(b"\1")


async def test_closing_ends_the_replay(session: Path) -> None:
    transport, ear = ReplayTransport(session), Ear()
    with pytest.raises(ConnectionLost, match="not open"):
        await transport.send(b"\1")
    await transport.open(ear)
    with pytest.raises(OpenError, match="make another"):
        await transport.open(Ear())
    await transport.close()
    await transport.close()
    await asyncio.sleep(10)
    assert (ear.heard, ear.losses) == (b"", [None])
    with pytest.raises(ConnectionLost, match="closed"):
        await transport.send(b"\1")


def test_what_a_recorder_wrote_can_be_replayed(tmp_path: Path) -> None:
    path = tmp_path / "session.jsonl"

    async def record() -> None:
        near, far = MemoryTransport.pair()
        transport, ear, end = RecordingTransport(near, path), Ear(), Ear()
        await far.open(end)
        await transport.open(ear)
        for size in range(1, 20):
            await transport.send(bytes(size))
            await end.hear(sum(range(size + 1)))
            await far.send(bytes([size]) * size)
            await ear.hear(sum(range(size + 1)))
            await asyncio.sleep(0.01)
        await transport.close()
        await far.close()

    async def replay() -> bytes:
        transport, ear = ReplayTransport(path), Ear()
        await transport.open(ear)
        for size in range(1, 20):
            await transport.send(bytes(size))
            await ear.hear(sum(range(size + 1)))
        await transport.close()
        return bytes(ear.heard)

    run(record())
    assert run(replay()) == b"".join(bytes([size]) * size for size in range(1, 20))


def _open_error(path: Path) -> str:
    async def main() -> None:
        await ReplayTransport(path).open(Ear())

    with pytest.raises(OpenError) as caught:
        run(main())
    return str(caught.value)


def test_a_missing_recording_is_told(tmp_path: Path) -> None:
    assert "cannot read the recording" in _open_error(tmp_path / "nothing.jsonl")
    assert "cannot read the recording" in _open_error(tmp_path)


def test_what_may_never_end_is_no_recording() -> None:
    assert "not a regular file" in _open_error(
        Path(os.devnull)
    )  # stands for a pipe, at which a failing test would hang


@pytest.mark.parametrize(
    "line",
    [
        "",
        "no json",
        "[]",
        '{"t": 1}',
        '{"t": 1, "said": "00"}',
        '{"t": 1, "sent": 5}',
        '{"t": 1, "sent": "0"}',
        '{"t": 0, "sent": "00"}',
        '{"t": NaN, "sent": "00"}',
        '{"t": Infinity, "sent": "00"}',
        '{"t": null, "sent": "00"}',
        '{"t": 1' + "0" * 400 + ', "sent": "00"}',
        '{"t": 1, "sent": "00", "received": "00"}',
        "[" * 100_000,
        "\x1b[2J\u202e",
    ],
)
def test_a_line_that_is_none_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "session.jsonl"
    path.write_text(f'{{"t": 0.5, "sent": "00"}}\n{line}\n')
    text = _open_error(path)
    assert "session.jsonl, line 2: not a line of a recording" in text
    assert text.isprintable()


@pytest.mark.parametrize("handshake", [True, False])
async def test_a_program_is_played_again_handshake_included(tmp_path: Path, *, handshake: bool) -> None:
    path = tmp_path / "session.jsonl"
    recording = FaultyTransport(RecordingTransport(create("virtual://?servos=2"), path), Faults())
    async with connect(recording, handshake=handshake) as board:
        servos = await board.servos()
    for _ in range(3):
        async with connect(f"replay://{path}", handshake=handshake) as board:
            assert await board.servos() == servos


async def test_a_line_that_a_crash_cut_short_is_left_out(session: Path) -> None:
    with session.open("a") as file:
        file.write('{"t": 9.5, "se')
    transport, ear = ReplayTransport(session), Ear()
    await transport.open(ear)
    await ear.hear(1)
    await transport.close()
    assert ear.losses == [None]


@given(st.binary())
def test_any_file_is_a_recording_or_one_readable_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.jsonl"
    path.write_bytes(content + b"\n")
    assert "any.jsonl, line 1: not a line of a recording" in _open_error(path)
