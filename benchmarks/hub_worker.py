"""The process of the benchmark of the hub that owns the board: prints the addresses, and serves until its input ends.

`python -m benchmarks.hub_worker PATH CORE`
"""

from __future__ import annotations

import asyncio
import json
import os
import sys

from servolink.hub.serving import serve_board


async def _serve(path: str) -> None:
    async with serve_board(path, name="bench", tcp="127.0.0.1:0") as (_, urls):
        sys.stdout.write(json.dumps(urls) + "\n")
        sys.stdout.flush()
        await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    if sys.argv[2]:
        os.sched_setaffinity(0, {int(sys.argv[2])})
    asyncio.run(_serve(sys.argv[1]))
