"""Image, settings and installation of the firmware.

Modules: servolink.firmware.compiling, servolink.firmware.image.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from servolink.errors import OpenError
from servolink.firmware import compiling, image, install
from servolink.transports import DeviceInfo, PortIdentity
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
