"""`servolink firmware` installs an image, shows it and builds it.

Module: servolink.cli.boards.firmware.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from serial.tools import list_ports  # type: ignore[import-untyped]
from serial.tools.list_ports_common import ListPortInfo  # type: ignore[import-untyped]

from servolink import firmware
from servolink.cli import command_session
from servolink.cli.main import run as main
from servolink.cli.usage import WrongUsage
from servolink.firmware import PRODUCT, USB_ID, Range, from_uf2, read_settings

PORT = ListPortInfo("/dev/ttyACM7", skip_link_detection=True)
PORT.vid, PORT.pid = USB_ID
PORT.product, PORT.serial_number = PRODUCT, "0102030405060708"


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    (tmp_path / "INFO_UF2.TXT").write_text("UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n")
    return tmp_path


def test_install_writes_the_image_and_examines_the_board(
    drive: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (drive / "ranges.json").write_text('{"3": [600, 2400, -60, 60]}')

    async def drive_there(*_: object) -> Path:
        return drive

    monkeypatch.setattr(firmware, "wait_for_drive", drive_there)
    monkeypatch.setattr(list_ports, "comports", lambda: [PORT] if (drive / "servolink.uf2").exists() else [])
    options = (
        "--drive",
        str(drive),
        "--pulses",
        str(drive / "ranges.json"),
        "--servos",
        "4",
        "--battery",
        "6.4-8.4",
        "--yes",
        "--json",
    )
    main(["firmware", "install", *options])
    told = json.loads(capsys.readouterr().out)
    assert told["board"] == "serial:///dev/ttyACM7"
    assert told["wiring"]["GPIO 0 to 15"] == "signal of servos 1 to 16"
    assert told["findings"], "nothing answers at this port here"
    written = read_settings(from_uf2((drive / "servolink.uf2").read_bytes()))
    assert (written.servos, written.battery_empty, written.battery_full) == (4, 6400, 8400)
    assert written.ranges[2] == Range(600, 2400, -60, 60)


@pytest.mark.parametrize(
    ("option", "value", "cause"),
    [
        ("--servos", "17", "1 to 16"),
        ("--servos", "0", "1 to 16"),
        ("--battery", "8.4-6.4", "battery"),
        ("--battery", "6.4-inf", "as 6.4-8.4"),
        ("--pulses", "PULSES", "PULSES: servo '17'"),
        ("--pulses", "INFO_UF2.TXT", "is not JSON"),
        ("--pulses", "missing", "No such file"),
    ],
)
def test_install_refuses_values_before_it_writes(
    drive: Path, capsys: pytest.CaptureFixture[str], option: str, value: str, cause: str
) -> None:
    (drive / "PULSES").write_text('{"17": [500, 2500, -90, 90]}')
    given = str(drive / value) if option == "--pulses" else value
    with pytest.raises(WrongUsage) as refused:
        main(["firmware", "install", "--drive", str(drive), option, given, "--yes"])
    refused.value.report()
    assert cause in capsys.readouterr().err
    assert not (drive / "servolink.uf2").exists()


def test_install_without_a_terminal_needs_a_yes(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command_session, "can_ask", lambda: False)
    with pytest.raises(WrongUsage):
        main(["firmware", "install", "--drive", str(drive)])
    assert not (drive / "servolink.uf2").exists()


def test_install_refuses_a_folder_that_is_no_pico(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["firmware", "install", "--drive", str(tmp_path), "--yes"]) != 0
    assert "INFO_UF2.TXT" in capsys.readouterr().err


def test_info_shows_image_and_wiring(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["firmware", "info"]) == 0
    assert "2e8a:000a" in (shown := capsys.readouterr().out)
    assert "GPIO 26" in shown
    main(["firmware", "info", "--json"])
    assert json.loads(capsys.readouterr().out)["settings"]["servos"] == 16


def test_build_says_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["firmware", "build", str(tmp_path / "out")]) != 0
    assert "gcc-arm-none-eabi" in capsys.readouterr().err
