"""Image of the firmware, as a file of UF2 blocks for the drive of a Pico, and settings in the image."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

FLASH_START = 0x10000000
"""Address of the flash of an RP2040."""
PAYLOAD = 256
"""Bytes of the image in each UF2 block."""
SERVOS = 16
"""Most servos of a board, and number of ranges in the settings."""
_BLOCK = struct.Struct("<8I476sI")
"""UF2 block: two start words, flags, address, size, number, count, family, payload, end word."""
_STARTS = (0x0A324655, 0x9E5D5157)
_END = 0x0AB16F30
_HAS_FAMILY = 0x2000
"""Flag of blocks with a family id."""
_RP2040 = 0xE48BFF56
"""Family id of the RP2040."""
_BOOT_SIZE = 252
"""Bytes of boot code, in front of the checksum."""
_MAGIC = b"servolink board\1"
"""Bytes in front of the settings in the image, as in `core/board.h`."""
_SETTINGS = struct.Struct("<BBHHH")
"""Settings in front of the ranges: servos, buttons, both voltages, reserved."""
_RANGE = struct.Struct("<HHhh")
"""Range of a servo: both pulse widths, both angles."""


@dataclass(frozen=True, slots=True)
class Range:
    """Range of a servo: pulse widths in microseconds at the least and at the greatest angle in degrees."""

    shortest: int = 500
    longest: int = 2500
    least: int = -90
    greatest: int = 90

    def check(self) -> None:
        """Raise ValueError for pulse widths or angles outside the possible range of servos."""
        if not self.least <= 0 <= self.greatest or self.least == self.greatest or max(-self.least, self.greatest) > 360:
            raise ValueError(
                f"angles {self.least} and {self.greatest}: must be -360 to 0 degrees, and 0 to 360 degrees"
            )
        if not all(100 <= width <= 5000 for width in (self.shortest, self.longest)) or self.shortest == self.longest:
            raise ValueError(
                f"the pulses {self.shortest} and {self.longest} must differ, and be 100 to 5000 microseconds"
            )


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """Settings of the board in the image; battery voltages in millivolts, both 0 for no battery."""

    servos: int = SERVOS
    buttons: int = 7
    battery_empty: int = 0
    battery_full: int = 0
    ranges: tuple[Range, ...] = (Range(),) * SERVOS


def _boot_checksum(data: bytes) -> int:
    """Return the CRC-32 of the boot code, which the boot ROM of the RP2040 compares."""
    total = 0xFFFFFFFF
    for byte in data:
        total ^= byte << 24
        for _ in range(8):
            total = (total << 1 ^ 0x04C11DB7 if total & 0x80000000 else total << 1) & 0xFFFFFFFF
    return total


def to_uf2(binary: bytes) -> bytes:
    """Return the UF2 blocks of an image; the first 252 bytes of the image are boot code."""
    boot = binary[:_BOOT_SIZE]
    data = boot + _boot_checksum(boot).to_bytes(4, "little") + binary[_BOOT_SIZE + 4 :]
    total = -(-len(data) // PAYLOAD)
    return b"".join(
        _BLOCK.pack(
            *_STARTS,
            _HAS_FAMILY,
            FLASH_START + PAYLOAD * number,
            PAYLOAD,
            number,
            total,
            _RP2040,
            data[PAYLOAD * number :][:PAYLOAD].ljust(PAYLOAD, b"\xff"),
            _END,
        )
        for number in range(total)
    )


def from_uf2(blocks: bytes) -> bytes:
    """Return the image in UF2 blocks. Raise ValueError for blocks of another device or a damaged file."""
    return b"".join(_payloads(blocks))


def _payloads(blocks: bytes) -> Iterator[bytes]:
    total, rest = divmod(len(blocks), _BLOCK.size)
    if rest or not total:
        raise ValueError("the file does not consist of UF2 blocks of 512 bytes")
    for number, fields in enumerate(_BLOCK.iter_unpack(blocks)):
        expected = (*_STARTS, _HAS_FAMILY, FLASH_START + PAYLOAD * number, PAYLOAD, number, total, _RP2040, _END)
        if (*fields[:8], fields[9]) != expected:
            raise ValueError(f"block {number} does not belong to an image for a Pico")
        yield fields[8][:PAYLOAD]


def _settings_at(binary: bytes) -> int:
    at = binary.find(_MAGIC)
    if at < 0:
        raise ValueError("the image has no settings of a servolink board")
    return at + len(_MAGIC)


def read_settings(binary: bytes) -> ImageSettings:
    """Return the settings in an image. Raise ValueError for an image without settings."""
    at = _settings_at(binary)
    servos, buttons, empty, full, _ = _SETTINGS.unpack_from(binary, at)
    ranges = [_RANGE.unpack_from(binary, at + _SETTINGS.size + _RANGE.size * servo) for servo in range(SERVOS)]
    return ImageSettings(servos, buttons, empty, full, tuple(Range(*each) for each in ranges))


def with_settings(binary: bytes, settings: ImageSettings) -> bytes:
    """Return the image with other settings.

    Raises:
        ValueError: A setting is out of range, or the image has no settings.

    """
    if not 1 <= settings.servos <= SERVOS:
        raise ValueError(f"a board has 1 to {SERVOS} servos, not {settings.servos}")
    if settings.buttons not in range(9):
        raise ValueError(f"a board has 0 to 8 buttons, not {settings.buttons}")
    if not 0 <= settings.battery_empty <= settings.battery_full <= 9900:
        raise ValueError("battery voltages must be 0 to 9900 mV, and the voltage of the full battery the higher")
    ranges: Sequence[Range] = settings.ranges
    for each in ranges:
        each.check()
    at = _settings_at(binary)
    packed = _SETTINGS.pack(settings.servos, settings.buttons, settings.battery_empty, settings.battery_full, 0)
    packed += b"".join(_RANGE.pack(each.shortest, each.longest, each.least, each.greatest) for each in ranges)
    return binary[:at] + packed + binary[at + len(packed) :]
