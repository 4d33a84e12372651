"""One process of the benchmark of many boards: `poll` asks them all, `serve` is them, `library` reads a large one.

Prints JSON. A process of its own for each count, because memory is not given back and CPU time is not divided.
"""

from __future__ import annotations

import asyncio
import gc
import json
import os
import resource
import sys
import tracemalloc
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from servolink.client.board import Board
from servolink.client.connect import connect
from servolink.protocol.records import Action, Step
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind
from servolink.virtual.serve import serve

PERIOD = 0.02
ACTIONS = 1800
_MEMORY = 4_000_000  # bytes of the board with the library


async def poll(seconds: float, urls: list[str]) -> dict[str, Any]:
    """Ask each board for its servos every 20 ms, all evenly shifted; "nothing" as a URL only waits."""
    async with AsyncExitStack() as stack:
        before = _memory()
        boards = [None if url == "nothing" else await stack.enter_async_context(connect(url)) for url in urls]
        for board in boards:
            if board is not None:
                await board.servos()
        gc.collect()
        held = _memory() - before
        loop = asyncio.get_running_loop()
        late: list[float] = []
        begun, cpu = loop.time() + 0.1, process_time()
        async with asyncio.TaskGroup() as group:
            for at, board in enumerate(boards):
                asks = board.servos if board is not None else _nothing
                group.create_task(_poll(asks, begun + PERIOD * at / len(boards), begun + seconds, late))
        cpu = process_time() - cpu
        gc.collect()
        return {
            "cpu": cpu / seconds,
            "memory": held,
            "grown": _memory() - before - held,
            "late": [round(delay * 1e6) for delay in sorted(late)],
            "share": len(late) / (len(urls) * seconds / PERIOD),
        }


async def _poll(asks: Callable[[], Awaitable[object]], due: float, until: float, late: list[float]) -> None:
    loop = asyncio.get_running_loop()
    while due < until:
        await asyncio.sleep(due - loop.time())
        if loop.time() >= until:
            return  # far behind: what is left undone is missing in the share
        await asks()
        late.append(loop.time() - due)
        due += PERIOD


async def _nothing() -> None:
    """Take no time at all."""


async def serve_boards(count: int) -> None:
    """Serve virtual boards over TCP until standard input ends."""
    async with AsyncExitStack() as stack:
        served = [await stack.enter_async_context(serve(VirtualBoard(), tcp="127.0.0.1:0")) for _ in range(count)]
        print(json.dumps([url for urls in served for url in urls]), flush=True)
        await asyncio.to_thread(sys.stdin.read)


async def serve_library() -> None:
    """Serve a board with a large library over TCP until standard input ends."""
    async with serve(VirtualBoard(kind=BoardKind(memory=_MEMORY)), tcp="127.0.0.1:0") as (url,), connect(url) as board:
        await _fill(board)
        print(json.dumps(url), flush=True)
        await asyncio.to_thread(sys.stdin.read)


async def _fill(board: Board) -> None:
    steps = tuple(Step(servo_id, 10 * servo_id % 90, 50) for servo_id in range(1, 17))
    for number in range(1, ACTIONS + 1):
        await board.add_action(Action(number, f"action {number}", steps))


async def library(url: str) -> dict[str, Any]:
    """List all actions of the board at `url`, read each, and export the project, once for time, once for memory."""
    async with connect(url) as board:
        found: dict[str, Any] = {}
        for name, read in _READINGS.items():
            sent, began, cpu = board.stats.frames_sent, perf_counter(), process_time()
            await read(board)
            found[name] = {
                "seconds": perf_counter() - began,
                "cpu": process_time() - cpu,
                "requests": board.stats.frames_sent - sent,
            }
            tracemalloc.start()
            kept = await read(board)
            found[name]["kept"], found[name]["peak"] = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            del kept
        return found


async def _list(board: Board) -> object:
    actions = await board.actions()
    assert len(actions) == ACTIONS  # noqa: S101 - or something else is measured
    return actions


async def _read_each(board: Board) -> object:
    return [await board.action(entry.action_id) for entry in await board.actions()]


async def _export(board: Board) -> object:
    project = await board.export_project()
    assert len(project.actions) == ACTIONS  # noqa: S101 - or something else is measured
    return project


_READINGS: dict[str, Callable[[Board], Awaitable[object]]] = {
    "actions()": _list,
    "action() of each": _read_each,
    "export_project()": _export,
}


def _memory() -> int:
    """Return the bytes of memory that this process occupies now, or at most so far where that is not known."""
    status = Path("/proc/self/statm")
    if status.exists():
        return int(status.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def main(what: str, *given: str) -> None:
    """Run one of the functions above."""
    if what == "serve":
        asyncio.run(serve_boards(int(given[0])))
    elif what == "serve-library":
        asyncio.run(serve_library())
    elif what == "library":
        print(json.dumps(asyncio.run(library(given[0]))))
    else:
        print(json.dumps(asyncio.run(poll(float(given[0]), list(given[1:])))))


if __name__ == "__main__":
    main(*sys.argv[1:])
