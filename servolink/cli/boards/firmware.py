"""`servolink firmware`: a board from a Raspberry Pi Pico."""

from __future__ import annotations

import argparse
import hashlib
import os
import re
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from servolink import firmware
from servolink.cli.arguments import not_empty
from servolink.cli.boards.doctor import Examination, examined, report_text
from servolink.cli.command import DEVELOPERS, Command, flag, option
from servolink.cli.command_session import Interruption, agreed, interruptible, refuse_without_answer
from servolink.cli.screen.output import Table, print_error
from servolink.cli.screen.result import CommandResult, Ending, Returned
from servolink.cli.usage import usage_error
from servolink.doctor import SystemFacts, examine
from servolink.errors import ServolinkError
from servolink.support import ExitCode, read_file, read_json

_WIRING = [
    ("GPIO 0 to 15", "signal of servos 1 to 16"),
    (
        "GPIO 16, 17",
        "UART, 115,200 baud: to the host's receiving and sending line; of 8 buttons, the last one at GPIO 17",
    ),
    ("GPIO 18 to 22, 27, 28", "buttons 1 to 7, to GND"),
    ("GPIO 26", "battery, through a divider to a third"),
    ("GND", "also to the servos' supply, which must not be the Pico's 3.3 V or USB"),
]
"""Pins of the Pico, each with the part to connect."""
_WIRING_TABLE = Table(("pin", "connect"), _WIRING)
_LARGEST = 1 << 20
"""Bytes of the largest file of ranges."""
_VOLTAGES = re.compile(r"([0-9]{1,3}(?:\.[0-9]+)?)-([0-9]{1,3}(?:\.[0-9]+)?)")
"""Value of the option `--battery`: volts of the empty and of the full battery."""
_DRIVE_SECONDS = 60.0
"""Seconds to wait for a Pico in boot mode."""
_PORT_SECONDS = 15.0
"""Seconds from the last block of the image to the serial port of the board."""

FIRMWARE = Command(
    "firmware",
    DEVELOPERS,
    help="make a board of a Raspberry Pi Pico and hobby servos",
    examples=("firmware info", "firmware install --servos 6"),
    takes_board=False,
)


class FirmwareInstalled(Examination, frozen=True, kw_only=True):
    """JSON of `firmware install`: the examination of the new board, and what to connect to each pin."""

    board: str
    wiring: dict[str, str]


class FirmwareBuilt(CommandResult, frozen=True):
    """JSON of `firmware build`; `is_same` says whether the image equals the one of servolink."""

    image: str
    is_same: bool


class FirmwareInfo(CommandResult, frozen=True):
    """JSON of `firmware info`; `usb` has the ids of vendor and product."""

    image: str
    sha256: str
    bytes_of_flash: int
    usb: str
    product: str
    settings: firmware.ImageSettings
    wiring: dict[str, str]


def _settings(args: argparse.Namespace, binary: bytes) -> firmware.ImageSettings:
    """Return the settings of the image, changed by the options. Raise ValueError for a wrong value."""
    settings = firmware.read_settings(binary)
    if args.pulses:
        settings = replace(settings, ranges=_read_ranges(Path(args.pulses), settings))
    if args.battery:
        voltages = _VOLTAGES.fullmatch(args.battery)
        if voltages is None:
            raise ValueError(
                f"--battery must be the volts of the empty and of the full one, as 6.4-8.4: {args.battery!r}"
            )
        empty, full = (round(float(volts) * 1000) for volts in voltages.groups())
        settings = replace(settings, battery_empty=empty, battery_full=full)
    # A count of 0 is a value too, which the image refuses or takes.
    counts = {name: getattr(args, name) for name in ("servos", "buttons") if getattr(args, name) is not None}
    return replace(settings, **counts)


def _read_ranges(path: Path, settings: firmware.ImageSettings) -> tuple[firmware.Range, ...]:
    """Return the ranges of all servos, changed by the file for `--pulses`. Raise ValueError with its name."""
    try:
        return _ranges(read_json(read_file(path, _LARGEST)), settings)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _ranges(given: Any, settings: firmware.ImageSettings) -> tuple[firmware.Range, ...]:
    """Return the ranges of all servos, changed by the content of the file for `--pulses`."""
    ranges = list(settings.ranges)
    if not isinstance(given, dict):
        raise ValueError("must be an object with an array for each servo")  # noqa: TRY004 - the content of a file
    for servo, values in given.items():
        if servo not in {str(number) for number in range(1, firmware.SERVOS + 1)}:
            raise ValueError(f"servo {servo!r} must be 1 to {firmware.SERVOS}")
        if not (isinstance(values, list) and len(values) == 4 and all(type(value) is int for value in values)):
            raise ValueError(f"servo {servo} must have two pulses and two angles, such as [500, 2500, -90, 90]")
        ranges[int(servo) - 1] = firmware.Range(*values)
    return tuple(ranges)


@Command(
    "firmware install",
    help="write the firmware onto a Pico in its boot mode, and see whether it answers",
    details="Hold the button BOOTSEL while you plug in the Pico. What an earlier servolink firmware stored stays.\n\n"
    "FILE for --pulses is JSON with pulse widths in microseconds and angles in degrees, at both ends, for servos that "
    'differ: {"1": [500, 2500, -90, 90]}.',
    examples=("firmware install", "firmware install --servos 6 --pulses ranges.json --battery 6.4-8.4"),
    options=(
        option("--drive", "FOLDER", "drive of the Pico (found by itself)", not_empty),
        option("--pulses", "FILE", "ranges of servos that differ from 500 to 2500 us for -90 to 90 degrees", not_empty),
        option("--servos", "N", "number of servos, 1 to 16 (16)", int),
        option("--buttons", "N", "number of buttons, 0 to 8 (7); with 8 there is no UART", int),
        option("--battery", "EMPTY-FULL", "volts of the empty and of the full battery, such as 6.4-8.4", not_empty),
        flag("--yes", "do not ask"),
    ),
    takes_board=False,
)
@interruptible("nothing was written")
async def run_install(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Write the image with its settings, wait for the board and examine it."""
    refuse_without_answer(args)
    binary = firmware.from_uf2(firmware.IMAGE.read_bytes())
    try:
        blocks = firmware.to_uf2(firmware.with_settings(binary, _settings(args, binary)))
    except ValueError as error:
        usage_error(args, str(error))
    # Ports of other boards with this firmware must not be mistaken for the new board.
    before = firmware.ports()
    if args.drive:
        drive = Path(args.drive)
        if not firmware.is_pico(drive):
            raise ServolinkError(f"{drive} is not the drive of a Pico in boot mode: its INFO_UF2.TXT is missing")
    else:
        drive = await firmware.wait_for_drive(
            _DRIVE_SECONDS,
            lambda: print_error("servolink: hold the button BOOTSEL of the Pico while you plug it in"),
        )
    if not await agreed(args, interruption, f"write the firmware onto the Pico at {drive}?"):
        return ExitCode.FAILED
    interruption.state = "the Pico may have no firmware: install it again"
    firmware.write(drive, blocks)
    interruption.state = "the firmware was written to the Pico"
    port = await firmware.wait_for_port(before, _PORT_SECONDS)
    report = await examine(SystemFacts(), port.url)
    return Returned(
        FirmwareInstalled(board=port.url, **examined(report), wiring=dict(_WIRING)),
        chain(
            [(f"the board is at {port.url}", "bold")],
            report_text(report, os.environ),
            [_WIRING_TABLE],
        ),
        ExitCode.FAILED if report.findings else ExitCode.OK,
    )


@Command(
    "firmware build",
    help="compile the firmware from the sources that servolink brings",
    details="Needs arm-none-eabi-gcc and its newlib. The same compiler makes the same bytes.",
    examples=("firmware build out",),
    options=(option("folder", "DIR", "folder for the image; made if needed", not_empty),),
    takes_board=False,
)
def run_build(args: argparse.Namespace) -> Returned:
    """Compile the firmware, and compare it with the image of the package."""
    path = firmware.build(Path(args.folder))
    # Another version of the compiler makes other bytes from the same sources.
    is_same = path.read_bytes() == firmware.IMAGE.read_bytes()
    text = f"{path}, {'the same as' if is_same else 'other bytes than'} the image of this servolink"
    return Returned(FirmwareBuilt(str(path), is_same), text)


@Command(
    "firmware info",
    help="show what the image of the firmware is, and how to wire a Pico",
    examples=("firmware info",),
    takes_board=False,
)
def run_info(_: argparse.Namespace) -> Returned:
    """Show the facts of the image, its settings and the wiring."""
    blocks = firmware.IMAGE.read_bytes()
    binary = firmware.from_uf2(blocks)
    settings = firmware.read_settings(binary)
    usb = "{:04x}:{:04x}".format(*firmware.USB_ID)
    digest = hashlib.sha256(blocks).hexdigest()
    image = str(firmware.IMAGE)
    facts = FirmwareInfo(image, digest, len(binary), usb, firmware.PRODUCT, settings, dict(_WIRING))
    one = settings.ranges[0]
    rows = [
        ("image", image),
        ("SHA-256", digest),
        ("flash", f"{len(binary):,} bytes"),
        ("USB", f"{usb}, product {firmware.PRODUCT!r}"),
        ("servos", f"{settings.servos}, {one.shortest} to {one.longest} us for {one.least} to {one.greatest} degrees"),
        ("buttons", str(settings.buttons)),
    ]
    return Returned(facts, [Table((), rows), "", _WIRING_TABLE])
