"""The recording that programs start and stop through the control interface of a hub."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from servolink.hub.engine.hub_recorder import HubRecorder
from servolink.hub.hub import Hub
from servolink.recorder import CommandDone, Event, Recording, ServosRead
from tests.hub.control_program import RpcFailed, shared
from tests.virtual_time import run


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have a folder of data in which nothing is."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    return tmp_path / "servolink" / "recordings"


def test_a_page_records(folder: Path) -> None:
    async def main() -> None:
        async with shared() as here, here.program("page") as page, here.program("other", "watch") as other:
            assert (await other.call("recorder.status"))["is_recording"] is False
            started = await page.call("recorder.start", hz=10)
            assert started["is_recording"] is True
            assert Path(started["file"]).parent == folder
            assert started["name"].startswith("rex-")
            await page.call("move", targets={"1": 60}, duration=0.5, wait=True)
            await page.call("recorder.mark", text="there")
            await asyncio.sleep(2)
            running = await other.call("recorder.status")
            assert running["size_bytes"] > 0
            stopped = await page.call("recorder.stop")
            assert stopped["is_recording"] is False
            assert stopped["messages"] > 20
            assert [notice["event"] for notice in other.of("recording")] == ["started", "marked", "stopped"]
            assert other.of("recording")[1]["text"] == "there"
            listed = await other.call("recorder.list")
            assert [each["name"] for each in listed["recordings"]] == [started["name"]]
            assert listed["recordings"][0]["size_bytes"] == stopped["size_bytes"]

    run(main())
    (path,) = folder.iterdir()
    recording = Recording(path)
    found = [entry.message for entry in recording.entries()]
    assert recording.remarks == []
    assert Event("mark", "there", "page") in found
    assert any(isinstance(each, CommandDone) and each.who == "page" for each in found)
    assert sum(isinstance(each, ServosRead) for each in found) > 20


async def test_one_at_a_time_and_none_by_a_spectator() -> None:
    async with shared() as here, here.program("page") as page, here.program("other", "watch") as other:
        for method in ("recorder.stop", "recorder.mark"):
            with pytest.raises(RpcFailed, match="nothing is being recorded") as failed:
                await page.call(method)
            assert failed.value.kind == "RecordingError"
        with pytest.raises(RpcFailed, match="needs the role run"):
            await other.call("recorder.start")
        await page.call("recorder.start", hz=0)
        with pytest.raises(RpcFailed, match="is being recorded already"):
            await page.call("recorder.start")
        await page.call("recorder.stop")
        await page.call("recorder.start", wire_only=True)  # in the same second
        assert len((await page.call("recorder.list"))["recordings"]) == 2


def test_the_end_of_the_hub_ends_it(folder: Path) -> None:
    async def main() -> None:
        async with shared() as here:
            async with here.program("page") as page:
                await page.call("recorder.start")
            await asyncio.sleep(3)  # it goes on without the program
            assert here.interface.recorder.now().is_recording

    run(main())
    (path,) = folder.iterdir()
    recording = Recording(path)
    assert list(recording.entries())[-1].seconds > 2
    assert recording.remarks == []


@pytest.mark.parametrize("full", [False, True])
async def test_a_forgotten_recording_is_ended(full: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if full:
        monkeypatch.setattr("servolink.hub.engine.hub_recorder._free", lambda folder: 1000)
    async with shared() as here, here.program("page") as page:
        recorder = _small(here.hub, tmp_path / "here", 10**9 if full else 2000)
        await recorder.start("page", hz=0, wire_only=False)
        while recorder.now().is_recording:
            await page.call("servos.list")
            await asyncio.sleep(0.1)
        assert "was ended" in (await page.until("problem"))["text"]
        assert (await page.until("recording"))["event"] == "stopped"


def _small(hub: Hub, folder: Path, most: int) -> HubRecorder:
    async def open_board() -> None:
        raise AssertionError

    return HubRecorder(hub, open_board, folder=folder, most=most)  # type: ignore[arg-type]
