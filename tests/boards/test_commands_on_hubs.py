"""What commands say of a board that a hub shares."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from servolink.boards import searching as search
from servolink.boards.announcements import announced
from servolink.boards.hubs import HubClaim
from servolink.boards.names import Alias, Aliases
from servolink.doctor import SystemFacts, check_holders
from servolink.transports import DeviceInfo
from tests.cli.programs import call

URL = "tcp://127.0.0.1:1"
SHARED = f"shared by a hub (pid {os.getpid()})"


@pytest.fixture(autouse=True)
def _hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
    Aliases.save("lab", Alias(URL))
    with asyncio.run(HubClaim.of("rex")) as claim:
        claim.announce(URL)
        yield


def test_list_shows_the_hub_and_its_board(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "list")
    assert [line.split("  ") for line in said.out.splitlines()[1:]] == [["share://rex", f"{SHARED}: {URL}"]]
    (found,) = call(capsys, "list", "--json").json["boards"]
    assert found["shares"] == URL


def test_an_address_in_use_names_the_hub(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--board", URL, "info")
    assert f"It is {SHARED}: use share://rex (`servolink share --status` shows its programs)" in said.err


def test_a_name_leads_to_the_hub(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--board", "lab", "info")
    assert "share://rex: no hub of this name is running" in said.err  # nobody listens in this test


def test_a_board_is_learnt_alone(capsys: pytest.CaptureFixture[str]) -> None:
    """A hub would answer in place of the board, and with the hub's own times."""
    said = call(capsys, "doctor", "lab", "--learn", "--yes")
    assert f"{URL} is {SHARED}: use share://rex, or end that hub for exclusive use of the board" in said.err


def test_the_doctor_wants_no_hub_to_be_killed() -> None:
    (finding,) = check_holders(SystemFacts(), URL)
    assert finding.observation == f"{URL} is {SHARED}"
    assert "servolink --board share://rex" in finding.remedy


def test_a_shared_board_is_one_board(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The doctor queries it through its hub, as every command does."""
    monkeypatch.setattr(search, "_KINDS", ("servolink.boards.announcements", "servolink.boards.hubs"))
    with announced(DeviceInfo(URL, "virtual board")):
        said = call(capsys, "doctor")
    assert "2 boards are here" not in said.out
    assert "share://rex: no hub of this name is running" in said.out  # nobody listens in this test
