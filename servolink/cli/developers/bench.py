"""`servolink bench`: how fast the board responds."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Callable
from typing import Any

from msgspec import Struct

from servolink.cli.arguments import whole_number
from servolink.cli.command import DEVELOPERS, Command, option
from servolink.cli.command_session import KEEP_MODE, Interruption, on_board
from servolink.cli.screen.live import counting
from servolink.cli.screen.output import Table
from servolink.cli.screen.result import CommandResult, Returned
from servolink.client import Board
from servolink.protocol import ACTION, ALL_SERVOS, Query, QueryMemorySizeRequest, QueryServoRequest

_QUERIES: tuple[tuple[str, Query[Any]], ...] = (
    ("shortest response: free memory", QueryMemorySizeRequest()),
    ("state of all servos", QueryServoRequest(ALL_SERVOS)),
    ("list of actions", ACTION.list_request),
)
_PERCENTILES = (50, 90, 99)


class QueryMeasured(Struct, frozen=True):
    """Rates of one kind of query, and round trips in seconds by percentile; null if all responses came late."""

    request: str
    requests_per_second: float
    bytes_per_second: int
    round_trip_seconds: dict[str, float | None]


class BoardMeasured(CommandResult, frozen=True):
    """JSON of `bench`, with the counters of the connection."""

    url: str
    requests: int
    results: list[QueryMeasured]
    stats: dict[str, Any]


@Command(
    "bench",
    DEVELOPERS,
    help="measure round trips to the board",
    examples=("bench", "bench --requests 20 --json"),
    options=(
        option("--requests", "N", "how many of each kind (200)", whole_number(1, 100_000), default=200),
        KEEP_MODE,
    ),
)
@on_board()
async def run(args: argparse.Namespace, board: Board, interruption: Interruption) -> Returned:
    """Measure each kind of query in turn; nothing on the board is changed."""
    results = []
    for what, query in _QUERIES:
        with counting(what, args.requests) as count:
            results.append(await _measure(board, query, args.requests, count))
    stats = board.stats.as_dict()
    rows = [
        (
            what,
            round(result.requests_per_second),
            result.bytes_per_second,
            # None if every response came late, when the query had been sent again.
            *(seconds and round(seconds * 1000, 2) for seconds in result.round_trip_seconds.values()),
        )
        for (what, _), result in zip(_QUERIES, results, strict=True)
    ]
    percentiles = (f"p{percent} ms" for percent in _PERCENTILES)
    table = Table(("query", "responses/s", "bytes/s", *percentiles), rows, f"{args.requests} of each kind")
    late = f"responses too late: {stats['timeouts']}, bytes outside frames: {sum(stats['skipped'].values())}"
    return Returned(BoardMeasured(board.url, args.requests, results, stats), [table, late])


async def _measure(board: Board, query: Query[Any], requests: int, count: Callable[[], None]) -> QueryMeasured:
    """Return rates and round trips, in seconds, of repeated queries."""
    loop = asyncio.get_running_loop()
    board.stats.round_trips.clear()
    received, start = board.stats.bytes_received, loop.time()
    for _ in range(requests):
        await board.request(query)
        count()
    seconds = max(loop.time() - start, 1e-9)
    times = {f"p{percent}": board.stats.round_trip(percent) for percent in _PERCENTILES}
    rate = round((board.stats.bytes_received - received) / seconds)
    return QueryMeasured(type(query).__name__, round(requests / seconds, 1), rate, times)
