"""`servolink firmware`: a board from a Raspberry Pi Pico."""

from __future__ import annotations

import argparse
import hashlib
import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from servolink.cli.arguments import not_empty
from servolink.cli.boards.doctor import described, print_report
from servolink.cli.command import DEVELOPERS, Command, flag, option
from servolink.cli.command_session import Interruption, agreed, refuse_without_answer, run_interruptible
from servolink.cli.screen.output import Table, print_error, print_json, print_result, print_table, print_text
from servolink.cli.usage import usage_error
from servolink.doctor.examine import examine
from servolink.doctor.system import SystemFacts
from servolink.errors import ServolinkError
from servolink.files import read_file
from servolink.firmware import compiling, image, install
from servolink.json_text import read_json
from servolink.script import FAILED, OK

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


def _settings(args: argparse.Namespace, binary: bytes) -> image.ImageSettings:
    """Return the settings of the image, changed by the options. Raise ValueError for a wrong value."""
    settings = image.read_settings(binary)
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


def _read_ranges(path: Path, settings: image.ImageSettings) -> tuple[image.Range, ...]:
    """Return the ranges of all servos, changed by the file for `--pulses`. Raise ValueError with its name."""
    try:
        return _ranges(read_json(read_file(path, _LARGEST)), settings)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _ranges(given: Any, settings: image.ImageSettings) -> tuple[image.Range, ...]:
    """Return the ranges of all servos, changed by the content of the file for `--pulses`."""
    ranges = list(settings.ranges)
    if not isinstance(given, dict):
        raise ValueError("must be an object with an array for each servo")  # noqa: TRY004 - the content of a file
    for servo, values in given.items():
        if servo not in {str(number) for number in range(1, image.SERVOS + 1)}:
            raise ValueError(f"servo {servo!r} must be 1 to {image.SERVOS}")
        if not (isinstance(values, list) and len(values) == 4 and all(type(value) is int for value in values)):
            raise ValueError(f"servo {servo} must have two pulses and two angles, such as [500, 2500, -90, 90]")
        ranges[int(servo) - 1] = image.Range(*values)
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
def run_install(args: argparse.Namespace) -> int:
    """Write the image with its settings, wait for the board and examine it."""
    refuse_without_answer(args)
    binary = image.from_uf2(compiling.IMAGE.read_bytes())
    try:
        blocks = image.to_uf2(image.with_settings(binary, _settings(args, binary)))
    except ValueError as error:
        usage_error(args, str(error))

    async def main(interruption: Interruption) -> int:
        # Ports of other boards with this firmware must not be mistaken for the new board.
        before = install.ports()
        if args.drive:
            drive = Path(args.drive)
            if not install.is_pico(drive):
                raise ServolinkError(f"{drive} is not the drive of a Pico in boot mode: its INFO_UF2.TXT is missing")
        else:
            drive = await install.wait_for_drive(
                _DRIVE_SECONDS,
                lambda: print_error("servolink: hold the button BOOTSEL of the Pico while you plug it in"),
            )
        if not await agreed(args, interruption, f"write the firmware onto the Pico at {drive}?"):
            return FAILED
        interruption.state = "the Pico may have no firmware: install it again"
        install.write(drive, blocks)
        interruption.state = "the firmware was written to the Pico"
        port = await install.wait_for_port(before, _PORT_SECONDS)
        report = await examine(SystemFacts(), port.url)
        if args.json:
            print_json({"board": port.url, **described(report), "wiring": dict(_WIRING)})
        else:
            print_text(f"the board is at {port.url}", "bold")
            print_report(report)
            print_table(Table(("pin", "connect"), _WIRING))
        return FAILED if report.findings else OK

    return run_interruptible(main, "nothing was written")


@Command(
    "firmware build",
    help="compile the firmware from the sources that servolink brings",
    details="Needs arm-none-eabi-gcc and its newlib. The same compiler makes the same bytes.",
    examples=("firmware build out",),
    options=(option("folder", "DIR", "folder for the image; made if needed", not_empty),),
    takes_board=False,
)
def run_build(args: argparse.Namespace) -> int:
    """Compile the firmware, and compare it with the image of the package."""
    path = compiling.build(Path(args.folder))
    # Another version of the compiler makes other bytes from the same sources.
    is_same = path.read_bytes() == compiling.IMAGE.read_bytes()
    text = f"{path}, {'the same as' if is_same else 'other bytes than'} the image of this servolink"
    print_result(args, {"image": str(path), "is_same": is_same}, text)
    return OK


@Command(
    "firmware info",
    help="show what the image of the firmware is, and how to wire a Pico",
    examples=("firmware info",),
    takes_board=False,
)
def run_info(args: argparse.Namespace) -> int:
    """Show the facts of the image, its settings and the wiring."""
    blocks = compiling.IMAGE.read_bytes()
    binary = image.from_uf2(blocks)
    settings = image.read_settings(binary)
    usb = "{:04x}:{:04x}".format(*install.USB_ID)
    digest = hashlib.sha256(blocks).hexdigest()
    if args.json:
        facts = {"image": str(compiling.IMAGE), "sha256": digest, "bytes_of_flash": len(binary)}
        print_json(
            {**facts, "usb": usb, "product": install.PRODUCT, "settings": asdict(settings), "wiring": dict(_WIRING)}
        )
        return OK
    one = settings.ranges[0]
    rows = [
        ("image", str(compiling.IMAGE)),
        ("SHA-256", digest),
        ("flash", f"{len(binary):,} bytes"),
        ("USB", f"{usb}, product {install.PRODUCT!r}"),
        ("servos", f"{settings.servos}, {one.shortest} to {one.longest} us for {one.least} to {one.greatest} degrees"),
        ("buttons", str(settings.buttons)),
    ]
    print_table(Table((), rows))
    print_text("")
    print_table(Table(("pin", "connect"), _WIRING))
    return OK
