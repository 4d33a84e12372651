"""Image, settings and installation of the firmware, and the command.

Modules: servolink.cli.boards.firmware, servolink.firmware.compiling, servolink.firmware.image,
servolink.platforms.drives.
"""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

import pytest

from servolink.cli import command_session
from servolink.cli.main import run as main
from servolink.cli.usage import WrongUsage
from servolink.errors import OpenError
from servolink.firmware import compiling, image, install
from servolink.platforms import drives
from servolink.transports.device_info import DeviceInfo, PortIdentity
from tests.firmware.conversations import frame
from tests.firmware.emulated import emulated, needs_emulator
from tests.firmware.test_core import READY, move

PORT = DeviceInfo("serial:///dev/ttyACM7", install.PRODUCT, PortIdentity(*install.USB_ID, "0102030405060708"))


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    (tmp_path / "INFO_UF2.TXT").write_text("UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n")
    return tmp_path


def test_the_image_is_one_of_a_pico_with_usual_settings() -> None:
    blocks = compiling.IMAGE.read_bytes()
    binary = image.from_uf2(blocks)
    assert image.to_uf2(binary) == blocks
    assert image.read_settings(binary) == image.ImageSettings()
    stack, start = struct.unpack_from("<II", binary, 256)
    assert stack == 0x20042000
    assert 0x20000000 < start < 0x20000000 + len(binary)
    assert start % 2 == 1


@pytest.mark.parametrize("damage", [b"", b"x" * 512, None])
def test_other_files_are_no_image(damage: bytes | None) -> None:
    blocks = compiling.IMAGE.read_bytes()
    with pytest.raises(ValueError, match=r"block"):
        image.from_uf2(blocks[512:] if damage is None else damage)


def test_settings_are_replaced_and_nothing_else() -> None:
    binary = image.from_uf2(compiling.IMAGE.read_bytes())
    settings = image.ImageSettings(6, 8, 6400, 8400, (image.Range(2500, 500, -80, 100), *[image.Range()] * 15))
    changed = image.with_settings(binary, settings)
    assert image.read_settings(changed) == settings
    assert image.with_settings(changed, image.ImageSettings()) == binary


def test_the_drive_of_a_pico_is_found_among_the_mounted_ones(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert install.find_drives() == []
    monkeypatch.setattr(install, "mounted_drives", lambda: [Path("/"), drive.parent, drive, drive / "missing"])
    assert install.find_drives() == [drive]


@pytest.mark.skipif(sys.platform != "linux", reason="Linux lists mount points in a file, with escaped spaces")
def test_mount_points_may_have_spaces(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Path("/proc") in drives.mounted_drives()
    monkeypatch.setattr(Path, "read_text", lambda *_: "/dev/sda1 /media/ada/RPI\\040RP2 vfat rw 0 0\n")
    assert drives.mounted_drives() == [Path("/media/ada/RPI RP2")]


@pytest.mark.parametrize(
    "settings",
    [
        image.ImageSettings(servos=0),
        image.ImageSettings(servos=17),
        image.ImageSettings(buttons=9),
        image.ImageSettings(battery_empty=2, battery_full=1),
        image.ImageSettings(ranges=(image.Range(500, 500), *[image.Range()] * 15)),
        image.ImageSettings(ranges=(image.Range(0, 2500), *[image.Range()] * 15)),
        image.ImageSettings(ranges=(image.Range(least=10), *[image.Range()] * 15)),
    ],
)
def test_impossible_settings_are_refused(settings: image.ImageSettings) -> None:
    with pytest.raises(ValueError, match=r"must|a board has"):
        image.with_settings(image.from_uf2(compiling.IMAGE.read_bytes()), settings)


@needs_emulator
def test_ranges_in_the_image_are_those_of_the_pulses(tmp_path: Path) -> None:
    binary = image.from_uf2(compiling.IMAGE.read_bytes())
    ranges = (image.Range(2000, 1000, -45, 45), image.Range(600, 2400, 0, 180), *[image.Range()] * 14)
    path = tmp_path / "image.uf2"
    path.write_bytes(image.to_uf2(image.with_settings(binary, image.ImageSettings(servos=2, ranges=ranges))))
    with emulated(path) as pico:
        assert pico.ask(frame(20010))[8:11] == bytes([2, 1, 2])
        pico.ask(READY)
        pico.ask(move((1, 90, 0), (2, 90, 0)), 1.2)
        assert [pico.pulses[pin][-1][1] for pin in (0, 1)] == pytest.approx([1000, 1500], abs=1)


def test_install_writes_the_image_and_examines_the_board(
    drive: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (drive / "ranges.json").write_text('{"3": [600, 2400, -60, 60]}')
    monkeypatch.setattr(install, "find_drives", lambda: [drive])
    monkeypatch.setattr(install, "search", lambda: [PORT] if (drive / "servolink.uf2").exists() else [])
    options = ("--pulses", str(drive / "ranges.json"), "--servos", "4", "--battery", "6.4-8.4", "--yes", "--json")
    main(["firmware", "install", *options])
    told = json.loads(capsys.readouterr().out)
    assert told["board"] == PORT.url
    assert told["wiring"]["GPIO 0 to 15"] == "signal of servos 1 to 16"
    assert told["findings"], "nothing answers at this port here"
    written = image.read_settings(image.from_uf2((drive / "servolink.uf2").read_bytes()))
    assert (written.servos, written.battery_empty, written.battery_full) == (4, 6400, 8400)
    assert written.ranges[2] == image.Range(600, 2400, -60, 60)


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
    refused.value.report(as_json=False)
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


async def test_waiting_for_a_pico_says_how_to_start_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install, "find_drives", list)
    told = list[None]()
    with pytest.raises(OpenError, match="BOOTSEL"):
        await install.wait_for_drive(5, lambda: told.append(None))
    assert told == [None]
    monkeypatch.setattr(install, "find_drives", lambda: [Path("/a"), Path("/b")])
    with pytest.raises(OpenError, match="several"):
        await install.wait_for_drive(5, lambda: None)


async def test_only_a_new_port_with_the_ids_and_the_product_is_the_board(monkeypatch: pytest.MonkeyPatch) -> None:
    others = [
        DeviceInfo("serial:///dev/ttyACM0", install.PRODUCT, PortIdentity(0x1209, 1)),
        DeviceInfo("serial:///dev/ttyACM1", "Pico", PortIdentity(*install.USB_ID)),
    ]
    monkeypatch.setattr(install, "search", lambda: [*others, PORT])
    assert await install.wait_for_port([], 1) == PORT
    with pytest.raises(OpenError, match="unplug"):
        await install.wait_for_port([PORT], 1)


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
