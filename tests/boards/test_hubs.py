"""Hubs have their names and boards for themselves, and are found in place of the boards that they share."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from servolink.boards import hubs
from servolink.boards import searching as search
from servolink.boards.announcements import announced
from servolink.boards.hubs import HubClaim, hub_of
from servolink.boards.names import Alias, Aliases, Resolved, resolve_board, resolve_url
from servolink.boards.searching import boards, only
from servolink.errors import OpenError
from servolink.transports import DeviceInfo, PortIdentity
from tests.virtual_time import run

TCP = "tcp://127.0.0.1:9000"
SERIAL = DeviceInfo("serial:///dev/ttyACM0", "board", PortIdentity(0x1209, 1, "A1"))
HUB = DeviceInfo("share://rex", "shared by a hub (pid 1)", SERIAL.identity, shares=SERIAL.url)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.setattr(search, "_KINDS", ("servolink.boards.announcements", "servolink.boards.hubs"))
    return tmp_path / "servolink"


@contextmanager
def hub(name: str, url: str) -> Iterator[None]:
    with run(HubClaim.of(name)) as claim:
        claim.announce(url)
        yield


def test_a_hub_is_found_while_it_runs(folder: Path) -> None:
    with run(HubClaim.of("rex")) as claim:
        assert hubs.candidates() == []  # it does not listen yet
        claim.announce(TCP)
        assert hubs.candidates() == [DeviceInfo("share://rex", f"shared by a hub (pid {os.getpid()})", shares=TCP)]
        assert (folder / "rex.hub").stat().st_mode & 0o777 == 0o600
        assert folder.stat().st_mode & 0o777 == 0o700
    assert hubs.candidates() == []
    assert list(folder.iterdir()) == []


def test_a_name_is_that_of_one_hub() -> None:
    with hub("rex", TCP):
        with pytest.raises(OpenError, match=rf"shared by a hub \(pid {os.getpid()}\), for {TCP}, already.*--name"):
            run(HubClaim.of("rex"))
        with run(HubClaim.of("other")):
            pass
    with run(HubClaim.of("rex")), pytest.raises(OpenError, match="taken by a hub that is starting"):
        run(HubClaim.of("rex"))


async def test_the_hub_that_waits_for_a_name_does_not_stop_the_loop() -> None:
    """It may be that of other hubs, each of which must see in time that the beats of a program have stopped."""
    with ExitStack() as ending:
        ending.enter_context(await HubClaim.of("rex"))
        asyncio.get_running_loop().call_later(0.05, ending.close)  # never comes to it while the loop is blocked
        with await HubClaim.of("rex") as claim:
            assert claim.url == "share://rex"


def test_a_board_is_shared_by_one_hub() -> None:
    with (
        hub("rex", "serial:///dev/ttyACM0?baudrate=9600"),
        run(HubClaim.of("other")) as claim,
        pytest.raises(OpenError, match=r"serial:///dev/ttyACM0 is shared by a hub.*already: use share://rex"),
    ):
        claim.announce("serial:///dev/ttyACM0")
    with hub("one", "virtual://"), hub("two", "virtual://"):
        assert hub_of("virtual://") is None


def test_the_name_of_a_hub_that_was_killed_is_free(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    (folder / "rex.hub").write_text(json.dumps({"url": "share://rex", "shares": TCP}))
    with hub("rex", TCP):
        assert [each.url for each in hubs.candidates()] == ["share://rex"]
    (folder / "rex.hub").write_text(json.dumps({"url": "share://rex", "shares": TCP}))
    assert hubs.candidates() == []
    assert list(folder.iterdir()) == []


def test_a_file_that_is_replaced_while_it_is_locked_is_not_taken_for_the_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another hub ends, and removes the file, between opening and locking it."""
    opened: list[int] = []
    system_open = os.open

    def remove_first(path: Any, *arguments: Any, **options: Any) -> int:
        file = system_open(path, *arguments, **options)
        if Path(path).name == "rex.hub" and not opened:
            (folder / "rex.hub").unlink()
        opened.append(file)
        return file

    with monkeypatch.context() as patch:
        patch.setattr(os, "open", remove_first)
        claim = run(HubClaim.of("rex"))
    with claim:
        claim.announce(TCP)
        assert [each.url for each in hubs.candidates()] == ["share://rex"]
    assert len(opened) == 2


def test_a_failing_disk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with run(HubClaim.of("rex")) as claim, monkeypatch.context() as patch:
        patch.setattr(hubs, "write", fail)
        with pytest.raises(OpenError, match=r"the hub cannot be announced to programs: .*rex\.hub: No space left"):
            claim.announce(TCP)
    monkeypatch.setattr(os, "open", fail)
    with pytest.raises(OpenError, match="no hub can run here: No space left"):
        run(HubClaim.of("rex"))


@pytest.mark.parametrize("name", ["", "../x", "a/b", "x" * 65, "COM3", "a b", "-x", "é", "a.b"])
def test_a_name_is_letters_digits_and_dashes(name: str) -> None:
    with pytest.raises(OpenError, match="cannot be the name of a hub"):
        run(HubClaim.of(name))


@pytest.mark.skipif(sys.platform == "win32", reason="links, owners and modes are those of Unix")
def test_no_hub_runs_where_others_can_put_files(folder: Path, tmp_path: Path) -> None:
    (others := tmp_path / "others").mkdir(mode=0o700)
    folder.symlink_to(others)
    with pytest.raises(OpenError, match="belongs to another user, or is writable for others"):
        run(HubClaim.of("rex"))
    folder.unlink()
    folder.mkdir()
    folder.chmod(0o770)
    with pytest.raises(OpenError, match="belongs to another user, or is writable for others"):
        run(HubClaim.of("rex"))
    folder.chmod(0o700)
    (folder / "rex.hub").symlink_to(tmp_path / "victim")
    with pytest.raises(OpenError, match="no hub can run here"):
        run(HubClaim.of("rex"))
    assert not (tmp_path / "victim").exists()
    assert list(others.iterdir()) == []


def test_a_folder_that_others_may_read_becomes_private(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o755)
    with hub("rex", TCP):
        assert folder.stat().st_mode & 0o777 == 0o700


def test_the_search_leads_to_the_hub() -> None:
    with announced(DeviceInfo(TCP, "virtual board")), hub("rex", TCP):
        board, shared = search.search()
        assert board.problem == f"shared by a hub (pid {os.getpid()}): use share://rex"
        assert not shared.problem
        assert only([board, shared]) == "share://rex"
        assert boards([board, shared]) == [shared]
        assert asyncio.run(resolve_url(None)) == "share://rex"
        with pytest.raises(OpenError, match=f"{TCP} is shared by a hub"):
            asyncio.run(resolve_url(None, through_hub=False))


def test_of_the_ways_to_a_board_the_hub_is_taken() -> None:
    hid = DeviceInfo("hid://1209:0001/A1", "board", SERIAL.identity)
    assert boards([SERIAL, hid, HUB]) == [HUB]
    twin = replace(SERIAL, url="serial:///dev/ttyACM1")  # of an adapter whose maker gives all the same number
    assert boards([SERIAL, twin, HUB]) == [twin, HUB]


def test_a_name_leads_to_the_hub_of_its_board(monkeypatch: pytest.MonkeyPatch) -> None:
    Aliases.save("left", Alias(TCP))
    Aliases.save("toy", Alias("virtual://"))
    with hub("rex", TCP):
        assert asyncio.run(resolve_board("left")) == Resolved("share://rex", "left")
        assert asyncio.run(resolve_board("rex")) == Resolved("share://rex", "rex")
        assert asyncio.run(resolve_url(TCP)) == TCP
        for board in ("left", "rex", TCP, "share://rex"):
            with pytest.raises(
                OpenError, match=f"{TCP} is shared by a hub .*end that hub for exclusive use of the board"
            ):
                asyncio.run(resolve_url(board, through_hub=False))
    assert asyncio.run(resolve_board("left", through_hub=False)) == Resolved(TCP, "left")
    assert asyncio.run(resolve_url(TCP, through_hub=False)) == TCP
    with hub("left", "tcp://127.0.0.1:1"):  # the hub of another board
        assert asyncio.run(resolve_url("left")) == TCP
    with hub("other", "virtual://"):
        assert asyncio.run(resolve_url("toy")) == "virtual://"
    with hub("toy", "virtual://"):
        assert asyncio.run(resolve_url("toy")) == "share://toy"
    Aliases.save("right", Alias("serial:///dev/ttyACM7", "A1"))
    monkeypatch.setattr(hubs, "candidates", lambda: [HUB])
    assert asyncio.run(resolve_url("right")) == "share://rex"
