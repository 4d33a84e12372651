"""Firmware on an emulated Pico at its real clock: memory, round trips, requests per second, pulses under full load.

Needs the emulator (`npm install --prefix tests/firmware`), and the compiler for the size of the RAM.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from benchmarks.goals import at_most
from benchmarks.measuring import Result, Table, table
from servolink.firmware.compiling import IMAGE, build
from servolink.firmware.image import from_uf2
from tests.firmware.conversations import frame
from tests.firmware.emulated import EmulatedPico, emulated
from tests.firmware.test_core import READY, move

_CORE_HZ = 48_000_000
_FLASH, _RAM = 2 * 1024 * 1024, 264 * 1024
_LIMIT = 5.0
"""Emulated seconds after which a response is missing."""
_PERIOD = 0.02
_REQUESTS = {"memory": (frame(10030), 17), "state of 16 servos": (frame(20020, b"\xff"), 186)}
"""Requests, each with the length of its response in bytes."""


@dataclass(frozen=True)
class _Load:
    seconds: float
    requests: int
    latest: float
    """Longest time between two pulses beyond 20 ms, in microseconds."""
    widest: float
    """Largest difference of a pulse from its width, in microseconds."""


def run(*, short: bool) -> Result:
    """Measure."""
    seconds = 0.5 if short else 3.0
    rows, loads = list[list[object]](), list[_Load]()
    with emulated(IMAGE, "usb", _CORE_HZ) as pico:
        _hold(pico)
        for request, (data, size) in _REQUESTS.items():
            trip = _round_trip(pico, data, size, 3 if short else 20)
            load = _load(pico, data, size, seconds)
            loads.append(load)
            rows.append([f"{request}, {size} bytes", f"{trip * 1e3:.2f}", f"{load.requests / load.seconds:,.0f}"])
    latest, widest = max(load.latest for load in loads), max(load.widest for load in loads)
    notes = [
        "Emulated core of 48 MHz. The emulated USB host takes no time of its own, as a real one does.",
        "20 requests are always under way for the requests per second, and all pulses are watched meanwhile.",
    ]
    columns = ["response", "round trip, ms", "requests/s"]
    return {
        "goals": [
            at_most("pulses under full load: lateness", latest, 1.0, "{:.2f} us"),
            at_most("pulses under full load: difference in width", widest, 0.5, "{:.2f} us"),
        ],
        "tables": [
            _memory(),
            table("Requests over USB", columns, rows, notes),
        ],
    }


def _hold(pico: EmulatedPico) -> None:
    """Hold all servos at 0 degrees."""
    pico.ask(READY)
    pico.ask(move(*((servo, 0, 0) for servo in range(1, 17))), 1.1)


def _ask(pico: EmulatedPico, data: bytes, size: int) -> float:
    """Send requests, wait for so many bytes and return the seconds that it took."""
    began = pico.now
    received = pico.command(**{pico.line: data.hex()}, run=_LIMIT, until=size)
    if len(received) < size:
        raise RuntimeError(f"the emulated Pico sent {len(received)} of {size} bytes")
    return pico.now - began


def _round_trip(pico: EmulatedPico, data: bytes, size: int, times: int) -> float:
    return sorted(_ask(pico, data, size) for _ in range(times))[times // 2]


def _load(pico: EmulatedPico, data: bytes, size: int, seconds: float) -> _Load:
    """Keep 20 requests waiting for some time."""
    began, requests = pico.now, 0
    pico.pulses.clear()
    while pico.now - began < seconds:
        _ask(pico, data * 20, size * 20)
        requests += 20
    pulses = [pico.pulses[pin] for pin in range(16)]
    periods = [after[0] - before[0] for made in pulses for before, after in pairwise(made)]
    return _Load(
        pico.now - began,
        requests,
        max(abs(period - _PERIOD) for period in periods) * 1e6,
        max(abs(width - 1500) for made in pulses for _, width in made),
    )


def _memory() -> Table:
    with tempfile.TemporaryDirectory() as name:
        build(Path(name))
        command = ("arm-none-eabi-nm", "servolink-pico.elf")
        symbols = subprocess.run(command, cwd=name, capture_output=True, text=True, check=True).stdout  # noqa: S603 - no shell
    addresses = {words[2]: int(words[0], 16) for words in map(str.split, symbols.splitlines()) if len(words) == 3}
    ram = addresses["bss_end"] - addresses["image_start"]
    rows = [
        ["program in flash", f"{len(from_uf2(IMAGE.read_bytes())):,}", f"{_FLASH:,}"],
        ["RAM: records, responses, received bytes, program", f"{ram:,}", f"{_RAM:,}"],
    ]
    return table("Memory of the Pico", ["what", "bytes", "of"], rows)
