"""Fuzzing of the firmware by libFuzzer, with sanitizers: `python -m tests.firmware.fuzz INPUTS`."""

from __future__ import annotations

import random
import sys
import tempfile
from pathlib import Path

from tests import processes
from tests.firmware.conversations import PACKETS, content, frame
from tests.firmware.host import FIRMWARE, HARDWARE, compile_program

_FLAGS = ("-O2", "-fsanitize=fuzzer,address", "-fno-sanitize-coverage=trace-cmp", "-DBOARD_MEMORY=8192")
"""The target has an eighth of the memory: it starts fast, and its memory gets full."""
_SECONDS = 12 * 3600.0
"""Seconds after which it hangs."""


def _write_seeds(folder: Path) -> None:
    """Write a request of each kind, in the form that the target reads: lengths before the parts."""
    draw = random.Random(0)
    for packet_id, packet in PACKETS.items():
        data = frame(packet_id, content(draw, packet["fields"], odd=0))
        parts = (data[at : at + 63] for at in range(0, len(data), 63))
        (folder / str(packet_id)).write_bytes(b"".join(bytes([len(part) + 128]) + part for part in parts))


def fuzz(folder: Path, limit: str) -> str:
    """Compile the target, run it up to a limit, and return its report. Fail if an input makes it crash."""
    target = folder / "fuzz"
    compile_program(target, [HARDWARE, FIRMWARE / "host/fuzz.c"], *_FLAGS, compiler="clang")
    (corpus := folder / "corpus").mkdir()
    _write_seeds(corpus)
    command = (str(target), limit, "-max_len=4000", "-seed=1", str(corpus))
    return processes.run(command, check=True, limit=_SECONDS, cwd=folder).stderr


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        print(fuzz(Path(name), f"-runs={int(sys.argv[1])}").splitlines()[-1])
