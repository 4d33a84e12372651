"""The process of the benchmark of the recorder that records a hub: starts and stops when a line says so.

`python -m benchmarks.recorder_worker URL FOLDER`: each line of standard input starts or stops it, and gets a response.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from servolink.recorder.recorder import Wanted, record_at


async def _record(url: str, folder: Path) -> None:
    number = 0
    while await asyncio.to_thread(sys.stdin.readline):
        number += 1
        path = folder / f"{number}.mcap"
        async with record_at(url, Wanted(path, hz=0)):
            _say("recording")
            await asyncio.to_thread(sys.stdin.readline)
        _say(str(path))


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    asyncio.run(_record(sys.argv[1], Path(sys.argv[2])))
