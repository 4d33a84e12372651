"""A process of the benchmark of thousands of boards.

`python -m benchmarks.thousands_worker hubs NAME...`, `crowd URL COUNT` or `controller URL SECONDS ROUNDS COUNT`.
The first two print `ready`, and end with their input; the last prints a line as each phase begins, and its figures.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import AsyncExitStack
from time import process_time
from typing import Any

from benchmarks.fleet_processes import Process
from benchmarks.measuring import percentile
from servolink.connection.taps import Tap

_SERVOS = 16
_PAUSE, _PATIENCE = 0.1, 30.0  # seconds between two stops, and for all answers on a busy machine


class _StopTap(Tap):
    """Tap that notes when stops are written."""

    def __init__(self, stop: bytes) -> None:
        self.seconds: list[float] = []
        self._stop = stop

    def sent(self, data: bytes) -> None:
        if data == self._stop:
            self.seconds.append(asyncio.get_running_loop().time())


async def _hubs(names: list[str]) -> None:
    """Share virtual boards; answer each line with the moments at which stops were written, by board."""
    from servolink.hub.serving import serve_board
    from servolink.protocol.servos import ALL_SERVOS, SetServoParameterRequest

    taps = {}
    async with AsyncExitStack() as stack:
        for seed, name in enumerate(names):
            url = f"virtual://?servos={_SERVOS}&seed={seed}"
            hub, _ = await stack.enter_async_context(serve_board(url, name=name))
            taps[name] = _StopTap(hub.board.codec.encode(SetServoParameterRequest(ALL_SERVOS, 0, 1)))
            hub.board.connection.taps.add(taps[name])
        _say("ready")
        while await asyncio.to_thread(sys.stdin.readline):
            _say(json.dumps({name: tap.seconds for name, tap in taps.items()}))
            for tap in taps.values():
                tap.seconds = []


async def _crowd(url: str, count: int) -> None:
    """Join so many stand-ins."""
    from benchmarks.thousands_crowd import Crowd

    crowd = Crowd(count)
    await crowd.join(url)
    living = asyncio.create_task(crowd.live())
    _say("ready")
    await asyncio.to_thread(sys.stdin.read)
    living.cancel()


async def _controller(url: str, seconds: float, rounds: int, count: int) -> None:
    """Learn of all boards, look on for `seconds`, and stop all boards `rounds` times."""
    from servolink.fleet.client import connect

    loop = asyncio.get_running_loop()
    began = loop.time()
    async with connect(url, groups={}, may_move=False) as fleet:  # as `servolink fleet stop` does
        await fleet.list()
        found: dict[str, Any] = {"known": len(fleet.boards()), "learnt": loop.time() - began}
        _say(json.dumps({"phase": "rest"}))
        cpu = process_time()
        await asyncio.sleep(seconds)
        found["cpu_at_rest"] = (process_time() - cpu) / seconds
        _say(json.dumps({"phase": "stops"}))
        asked, last, used, confirmed = [], [], [], list[float]()
        for _ in range(rounds):
            asked.append(loop.time())
            cpu = process_time()
            stopped = await fleet.stop(patience=_PATIENCE)
            used.append(process_time() - cpu)
            if len(stopped.stopped) != count:
                raise SystemExit(f"{len(stopped.stopped)} of {count} boards stopped; silent: {stopped.silent[:3]}")
            confirmed += stopped.stopped.values()
            last.append(max(stopped.stopped.values()))
            await asyncio.sleep(_PAUSE)
        found |= {"asked": asked, "last": last, "cpu_of_stops": used, "memory": Process(os.getpid()).memory}
        found["confirmed"] = [percentile(confirmed, percent) for percent in (50, 99)]
    _say(json.dumps({"phase": "over"} | found))


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    _, role, *given = sys.argv
    if role == "hubs":
        asyncio.run(_hubs(given))
    elif role == "crowd":
        asyncio.run(_crowd(given[0], int(given[1])))
    else:
        asyncio.run(_controller(given[0], float(given[1]), int(given[2]), int(given[3])))
