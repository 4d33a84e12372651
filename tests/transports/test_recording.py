from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from servolink.errors import ConnectionLost, OpenError
from servolink.transports.memory import MemoryTransport
from servolink.transports.recording import RecordingTransport
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
        with pytest.raises(OpenError, match="exists already; remove it or record to another file"):
            await RecordingTransport(MemoryTransport.pair()[0], path).open(Ear())

    run(main())
    assert path.read_text() == "precious"


@pytest.mark.parametrize("name", ["no/such/folder.jsonl", "nul\0.jsonl"])
def test_a_file_that_cannot_be_made_is_told(tmp_path: Path, name: str) -> None:
    async def main() -> None:
        with pytest.raises(OpenError, match=r"cannot record to .*; choose another file"):
            await RecordingTransport(MemoryTransport.pair()[0], tmp_path / name).open(Ear())

    run(main())


def test_a_connection_that_cannot_be_opened_leaves_no_file(tmp_path: Path) -> None:
    async def main() -> None:
        with pytest.raises(OpenError):
            await RecordingTransport(create("/dev/servolink-nowhere"), tmp_path / "session.jsonl").open(Ear())

    asyncio.run(main())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device here that is always full")
def test_a_full_disk_ends_the_connection_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "open", lambda path, _, **options: open(path, "w", **options))  # noqa: SIM115

    async def main() -> None:
        near, far = MemoryTransport.pair()
        transport, ear, end = RecordingTransport(near, "/dev/full"), Ear(), Ear()
        await far.open(end)
        await transport.open(ear)
        await far.send(b"x")
        error = await ear.end()
        assert isinstance(error, ConnectionLost)
        assert "/dev/full cannot be written" in str(error)
        await end.end()
        with pytest.raises(ConnectionLost, match="cannot be written"):
            await transport.send(b"y")
        await transport.close()
        assert len(ear.losses) == 1

    run(main())
