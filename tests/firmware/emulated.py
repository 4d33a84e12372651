"""Pico in an emulator, with the image that is flashed."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import pytest

from tests import processes

FOLDER = Path(__file__).parent

needs_emulator = pytest.mark.skipif(
    shutil.which("node") is None or not (FOLDER / "node_modules/rp2040js").exists(),
    reason="needs rp2040js: npm install --prefix tests/firmware",
)


@dataclass
class EmulatedPico:
    """Pico whose time goes on only in `run` and `ask`."""

    process: subprocess.Popen[str]
    line: str
    now: float = 0.0
    resets: int = 0
    is_open: bool = False
    is_erasing: bool = False
    is_busy: bool = False
    """Whether flash is being erased or programmed."""
    longest: int = 0
    """Most instructions of one turn of the firmware's loop, in the last command."""
    pulses: dict[int, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))
    """Starts in seconds and widths in microseconds of the pulses at each pin."""
    _epoch: float | None = None
    _unsent: bytes = b""
    _received: bytes = b""

    def command(self, **asked: Any) -> bytes:
        """Give the bench a command, and return what the board transmitted meanwhile over its line."""
        return bytes.fromhex(self._command(asked)[self.line])

    def control(self, setup: bytes, data: bytes = b"") -> bytes | None:
        """Return the answer to a request to endpoint 0 of USB, None if it is refused."""
        answer = self._command({"setup": setup.hex(), "data": data.hex()})["control"]
        return None if answer is None else bytes.fromhex(answer)

    def _command(self, asked: dict[str, Any]) -> Any:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(asked) + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        assert answer["stalls"] == 0, "the firmware used the flash while it was busy"
        for pin, start, width in answer["pulses"]:
            self.pulses[pin].append((start, width))
        self.now, self.resets, self.is_open = answer["now"], answer["resets"], answer["open"]
        self.is_erasing, self.is_busy, self.longest = answer["erasing"], answer["busy"], answer["longest"]
        return answer

    def run(self, seconds: float) -> bytes:
        """Let time pass."""
        return self.command(run=seconds)

    def ask(self, data: bytes, seconds: float = 0.05) -> bytes:
        """Send bytes, and return what comes within some time."""
        return self.command(**{self.line: data.hex()}, run=seconds)

    def receive(self, data: bytes) -> None:
        """Keep bytes of the host for the next tick."""
        self._unsent += data

    def tick(self, now: int) -> None:
        """Let time pass up to a time in microseconds, which begins with the first call."""
        if self._epoch is None:
            self._epoch = now / 1e6 - self.now
        data, self._unsent = self._unsent, b""
        self._received += self.ask(data, max(0.0, now / 1e6 - self._epoch - self.now))

    def transmit(self) -> bytes:
        """Return what the board has transmitted up to the last tick."""
        data, self._received = self._received, b""
        return data

    def widths_since(self, pin: int, start: float) -> list[float]:
        """Return the widths of the pulses that began later than `start`."""
        return [width for begun, width in self.pulses[pin] if begun >= start]


@contextmanager
def emulated(
    image: Traversable, line: str = "uart", core_hz: int = 6_000_000, *, power: bool = True
) -> Iterator[EmulatedPico]:
    """Start a Pico with an image, which is reached by its UART or by USB. A real core has 48 MHz.

    `power` is whether the pin for it can see that the cable of USB has power, as that of a Pico W cannot.
    """
    command = ("node", str(FOLDER / "bench.mjs"), str(image), line, str(core_hz))
    process = processes.start(command, stdin=subprocess.PIPE)
    pico = EmulatedPico(process, line)
    pico.command(power=power, run=0.3)  # time to start, and for the USB host to find the board
    yield pico
    processes.finish(process)
