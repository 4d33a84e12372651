"""The process of the benchmark of the hub that owns the board: prints the addresses, and serves until its input ends.

`python -m benchmarks.hub_worker PATH CORE [relay]`; with `relay`, ten lines of asyncio take the place of the hub.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys

import serial_asyncio  # type: ignore[import-untyped]

from servolink.hub import serve_board
from servolink.protocol import MAGIC


async def _serve(path: str) -> None:
    async with serve_board(path, name="bench", tcp="127.0.0.1:0") as (_, urls):
        await _until_the_input_ends(urls)


async def _relay(path: str) -> None:
    """Serve as a program of ten lines does: one request after the other, and each response to its program."""
    board, to_board = await serial_asyncio.open_serial_connection(url=path, baudrate=115200)
    turn = asyncio.Lock()

    async def serve(program: asyncio.StreamReader, to_program: asyncio.StreamWriter) -> None:
        while requests := await program.read(4096):
            async with turn:
                to_board.write(requests)
                owed = requests.count(MAGIC)
                while owed > 0:
                    responses = await board.read(4096)
                    owed -= responses.count(MAGIC)
                    to_program.write(responses)

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        await _until_the_input_ends([f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"])


async def _until_the_input_ends(urls: list[str]) -> None:
    sys.stdout.write(json.dumps(urls) + "\n")
    sys.stdout.flush()
    await asyncio.to_thread(sys.stdin.read)


if __name__ == "__main__":
    path, core, *way = sys.argv[1:]
    if core:
        os.sched_setaffinity(0, {int(core)})
    asyncio.run(_relay(path) if way else _serve(path))
