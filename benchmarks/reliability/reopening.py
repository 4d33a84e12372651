"""Programs that begin while the board still owes an answer to the one before, which nothing tells from their own."""

from __future__ import annotations

import asyncio
from random import Random

from benchmarks.measuring import Result, table
from benchmarks.reliability.board import Character
from benchmarks.reliability.checker import Call
from benchmarks.reliability.clock import SimulatedLoop
from benchmarks.reliability.conversation import drawn
from benchmarks.reliability.history import DirectTransport
from benchmarks.reliability.line import Line
from benchmarks.reliability.stage import Scene, Stage
from servolink.protocol.packet import Packet, Request

_BOARD = Character("always slow", late=1.0)
_PATIENCE = 0.05
_CALLS = 3  # of the second program
_PAUSES = {"at once": 0.0, "2 s later": 2.0}


async def _begin_often(times: int, seed: int, pause: float) -> Result:
    """Let two programs follow each other so often; count what the second ones get."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)  # noqa: S101 - narrows the type
    stage = Stage(Scene(seed, Line("clean"), _BOARD), loop, lambda board: DirectTransport(board, loop))
    random = Random(f"reopening {seed}")
    counts, fooled = stage.checker.counts, 0
    for _ in range(times):
        await stage.connect(anew=True)
        asking = loop.create_task(stage.conversation.do(Call(0, _request(random))))
        await asyncio.wait((asking,), timeout=_PATIENCE)
        asking.cancel()
        await asyncio.wait((asking,))
        await stage.disconnect()
        await asyncio.sleep(pause)
        before = counts["wrong"]
        await stage.connect(anew=True)
        for _ in range(_CALLS):
            await stage.conversation.do(Call(0, _request(random)))
        await stage.disconnect()
        fooled += counts["wrong"] > before
        await asyncio.sleep(max(0.0, stage.board.free_at - loop.now) + 0.1)
    return {"begun": times, "fooled": fooled}


def _request(random: Random) -> Packet:
    while not isinstance(packet := drawn(random), Request):
        pass
    return packet


def run(*, short: bool, seed: int = 1) -> Result:
    """Begin 20,000 programs (short: 200) while an answer to the one before is still coming."""
    rows, figures = [], {}
    for when, pause in _PAUSES.items():
        with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
            figures[when] = found = runner.run(_begin_often(200 if short else 20_000, seed, pause))
        share = f"{found['fooled'] / found['begun']:.2%}"
        rows.append((when, f"{found['begun']:,}", f"{found['fooled']:,}", share))
    quote = table(
        "programs that start while a response to the previous one is outstanding",
        ("start", "programs", "got a wrong response", "share"),
        rows,
        notes=["responses come 0.1 to 1.5 s late; the first program ends after 50 ms, the next sends three queries"],
    )
    return {"tables": [quote], "wrong": [], "figures": figures}
