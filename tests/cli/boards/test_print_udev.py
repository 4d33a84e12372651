"""`servolink doctor --print-udev` prints the rules for boards that are here, or that are named.

Module: servolink.cli.boards.doctor.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.cli.boards import doctor
from servolink.transports import DeviceInfo
from tests.cli.programs import call
from tests.doctor.recorded import RecordedFacts
from tests.doctor.test_permissions import rule_lines


def test_the_command_prints_them_for_what_is_here(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "SystemFacts", lambda: RecordedFacts("desktop", tmp_path))
    monkeypatch.setattr(doctor, "search", lambda: [DeviceInfo("usb://1234:5678/A1"), DeviceInfo("tcp://x:1")])
    said = call(capsys, "doctor", "--print-udev")
    assert (said.code, said.err, len(rule_lines(said.out))) == (0, "", 3)


def test_without_a_board_on_usb_there_are_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "SystemFacts", lambda: RecordedFacts("wsl", tmp_path))
    monkeypatch.setattr(doctor, "search", list)
    for arguments in ((), ("tcp://x:1",), ("serial:///dev/ttyACM0",)):
        said = call(capsys, "doctor", "--print-udev", *arguments)
        assert (said.code, said.out) == (3, "")
        assert "plug the board in" in said.err


def test_a_board_that_is_not_here_can_be_named_by_its_ids(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "SystemFacts", lambda: RecordedFacts("wsl", tmp_path))
    for scheme in ("usb", "hid"):
        said = call(capsys, "doctor", "--print-udev", f"{scheme}://2345:6789")
        assert (said.code, said.err, len(rule_lines(said.out))) == (0, "", 3)
        assert all('"2345"' in line and '"6789"' in line for line in rule_lines(said.out))
    assert call(capsys, "doctor", "--print-udev", "usb://").code == 3
