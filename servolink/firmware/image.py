"""Image of the firmware: the file for the drive of a Pico (UF2), and the settings in it."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

FLASH_START = 0x10000000
PAYLOAD = 256
"""Bytes of the image in a block."""
SERVOS = 16
_BLOCK = struct.Struct("<8I476sI")
_STARTS = (0x0A324655, 0x9E5D5157)
_END = 0x0AB16F30
_HAS_FAMILY = 0x2000
_RP2040 = 0xE48BFF56
_BOOT_SIZE = 252
_MAGIC = b"servolink board\1"
_SETTINGS = struct.Struct("<BBHHH")
_RANGE = struct.Struct("<HHhh")


@dataclass(frozen=True, slots=True)
class Range:
    """Range of a servo: pulse widths in microseconds at the least and at the greatest angle in degrees."""

    shortest: int = 500
    longest: int = 2500
    least: int = -90
    greatest: int = 90

    def check(self) -> None:
        """Raise ValueError if no servo has such a range."""
        if not self.least <= 0 <= self.greatest or self.least == self.greatest or max(-self.least, self.greatest) > 360:
            raise ValueError(f"the angles {self.least} and {self.greatest} must be -360 to 0 and 0 to 360")
        if not all(100 <= width <= 5000 for width in (self.shortest, self.longest)) or self.shortest == self.longest:
            raise ValueError(f"the pulses {self.shortest} and {self.longest} must differ, and be 100 to 5000 microseconds")


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings in the image; voltages in millivolts, both 0 for no battery."""

    servos: int = SERVOS
    buttons: int = 7
    battery_empty: int = 0
    battery_full: int = 0
    ranges: tuple[Range, ...] = (Range(),) * SERVOS


def _boot_checksum(data: bytes) -> int:
    """Return the CRC-32 for which the boot ROM looks behind the first 252 bytes."""
    total = 0xFFFFFFFF
    for byte in data:
        total ^= byte << 24
        for _ in range(8):
            total = (total << 1 ^ 0x04C11DB7 if total & 0x80000000 else total << 1) & 0xFFFFFFFF
    return total


def to_uf2(binary: bytes) -> bytes:
    """Return the blocks for an image whose first 252 bytes are the boot code."""
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
    """Return the image in the blocks. Raise ValueError for other bytes."""
    return b"".join(_payloads(blocks))


def _payloads(blocks: bytes) -> Iterator[bytes]:
    total, rest = divmod(len(blocks), _BLOCK.size)
    if rest or not total:
        raise ValueError("the file does not consist of UF2 blocks of 512 bytes")
    for number, fields in enumerate(_BLOCK.iter_unpack(blocks)):
        expected = (*_STARTS, _HAS_FAMILY, FLASH_START + PAYLOAD * number, PAYLOAD, number, total, _RP2040, _END)
        if (*fields[:8], fields[9]) != expected:
            raise ValueError(f"block {number} is not one of an image for a Pico")
        yield fields[8][:PAYLOAD]


def _settings_at(binary: bytes) -> int:
    at = binary.find(_MAGIC)
    if at < 0:
        raise ValueError("the image is not servolink's: it has no settings")
    return at + len(_MAGIC)


def read_settings(binary: bytes) -> Settings:
    """Return the settings of an image. Raise ValueError if it has none."""
    at = _settings_at(binary)
    servos, buttons, empty, full, _ = _SETTINGS.unpack_from(binary, at)
    ranges = [_RANGE.unpack_from(binary, at + _SETTINGS.size + _RANGE.size * servo) for servo in range(SERVOS)]
    return Settings(servos, buttons, empty, full, tuple(Range(*each) for each in ranges))


def with_settings(binary: bytes, settings: Settings) -> bytes:
    """Return the image with other settings. Raise ValueError if it has none, or for settings out of range."""
    if not 1 <= settings.servos <= SERVOS:
        raise ValueError(f"a board has 1 to {SERVOS} servos, not {settings.servos}")
    if settings.buttons not in range(9):
        raise ValueError(f"a board has 0 to 8 buttons, not {settings.buttons}")
    if not 0 <= settings.battery_empty <= settings.battery_full <= 9900:
        raise ValueError("the battery must be at most 9900 mV, and no fuller when empty")
    ranges: Sequence[Range] = settings.ranges
    for each in ranges:
        each.check()
    at = _settings_at(binary)
    packed = _SETTINGS.pack(settings.servos, settings.buttons, settings.battery_empty, settings.battery_full, 0)
    packed += b"".join(_RANGE.pack(each.shortest, each.longest, each.least, each.greatest) for each in ranges)
    return binary[:at] + packed + binary[at + len(packed) :]
