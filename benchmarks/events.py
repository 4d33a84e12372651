"""Button events: how many a program can take in a second, with one reader or many."""

from __future__ import annotations

import asyncio
from time import process_time_ns

from benchmarks.instant import InstantTransport
from benchmarks.measuring import Result, table
from servolink.client.connecting import connect
from servolink.protocol.codec import Codec
from servolink.protocol.joystick import ButtonEventResponse

READERS = (1, 100)
CHUNKS = {"one event": 1, "4 KiB": 292}
"""Events that arrive at once, by what they arrive in; between two the readers run."""


def run(*, short: bool) -> Result:
    """Measure all numbers of readers; the best of all rounds counts, as a busy machine only adds."""
    rounds, total = (1, 2_000) if short else (5, 60_000)
    rates: dict[tuple[int, str], float] = {}
    for _ in range(rounds):
        for readers in READERS:
            for chunk, at_once in CHUNKS.items():
                chunks = max(1, total // readers // at_once)
                rate = asyncio.run(_rate(readers, at_once, chunks))
                rates[readers, chunk] = max(rate, rates.get((readers, chunk), 0))
    quote = table(
        "button events for each second of CPU",
        ("readers", *(f"in chunks of {chunk}" for chunk in CHUNKS)),
        [(readers, *(f"{rates[readers, chunk]:,.0f}" for chunk in CHUNKS)) for readers in READERS],
        ["Every reader is an iterator of its own that gets every event; an event counts once all readers have it."],
    )
    return {
        "tables": [quote],
        "rates": [{"readers": at[0], "chunk": at[1], "rate": rate} for at, rate in rates.items()],
    }


async def _rate(readers: int, at_once: int, chunks: int) -> float:
    """Return the events per second of CPU."""
    transport = InstantTransport()
    async with connect(transport) as board:
        events = chunks * at_once
        frames = b"".join(Codec().encode(ButtonEventResponse(number, 1)) for number in range(at_once))
        ready = asyncio.Semaphore(0)

        async def read() -> None:
            async with board.button_events(limit=max(1000, at_once * 4)) as came:
                ready.release()
                for _ in range(events):
                    await anext(came)

        async with asyncio.TaskGroup() as group:
            for _ in range(readers):
                group.create_task(read())
            for _ in range(readers):
                await ready.acquire()
            began = process_time_ns()
            for _ in range(chunks):
                transport.receive(frames)
                await asyncio.sleep(0)
                await asyncio.sleep(0)
        return events / (process_time_ns() - began) * 1e9
