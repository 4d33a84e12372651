"""The time until a program has its first response: opening the port, the queries of opening, and one request."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack
from itertools import pairwise
from statistics import median
from time import perf_counter

from benchmarks.answers import answers, exchange
from benchmarks.goals import at_most
from benchmarks.measuring import Result, table
from benchmarks.neighbours import Neighbours
from benchmarks.responder import Listener, Responder
from servolink.client.connect import connect

SENDINGS = 6
"""At most so many requests on opening a board that owes nothing."""
_PARTS = ("connect", "first response", "closing")


def run(*, short: bool) -> Result:
    """Open, ask once and close, on each kind of line in turns."""
    neighbours = Neighbours()
    times: dict[str, list[list[float]]] = {}
    sendings: dict[str, list[int]] = {}
    with ExitStack() as stack:
        responder, listener = Responder(answers()), Listener(answers())
        stack.callback(responder.close)
        stack.callback(listener.close)
        urls = {"pseudo-terminal": responder.path, "tcp://": listener.url, "virtual://": "virtual://"}
        for at in range(3 if short else 41):
            for name, url in urls.items():
                took, sent = asyncio.run(_open(url))
                if at:  # the first one imports the transport
                    times.setdefault(name, []).append(took)
                    sendings.setdefault(name, []).append(sent)
    most, where = max((median(sent), name) for name, sent in sendings.items())
    quote = table(
        "From nothing to the first response, ms",
        ("line", "requests on opening", *(f"{part}, {which}" for part in _PARTS for which in ("least", "median"))),
        [
            (
                name,
                f"{median(sendings[name]):.0f}",
                *(
                    f"{which([took[part] for took in of_line]) * 1000:.2f}"
                    for part in range(len(_PARTS))
                    for which in (min, median)
                ),
            )
            for name, of_line in times.items()
        ],
        [
            "Requests on opening: queries whose responses prove that none to an earlier program is still to come.",
            neighbours.note(),
        ],
    )
    return {
        "tables": [quote],
        "goals": [at_most(f"requests on opening a board that owes nothing; most: {where}", most, SENDINGS, "{:.0f}")],
        "times": times,
        "sendings": sendings,
    }


async def _open(url: str) -> tuple[list[float], int]:
    """Return the seconds of each part, and how many requests were sent on opening."""
    query, _ = exchange(14)
    times = [perf_counter()]
    board = await connect(url)
    sent = board.stats.frames_sent
    times.append(perf_counter())
    await board.request(query)
    times.append(perf_counter())
    await board.close()
    times.append(perf_counter())
    return [later - earlier for earlier, later in pairwise(times)], sent
