"""How many queries and openings succeed on a board that loses, damages or delays its responses, and how soon."""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from dataclasses import dataclass
from random import Random

from benchmarks.answers import answers
from benchmarks.goals import at_least, at_most, missed, sentence
from benchmarks.instant import requests
from benchmarks.measuring import Result, table
from servolink.connection import Connection, ConnectionOptions
from servolink.errors import OpenError, RequestError
from servolink.protocol import ALL_SERVOS, QueryServoRequest
from servolink.transports import BaseTransport
from tests.virtual_time import VirtualTimeLoop

_ON_EACH = 20  # queries on one connection
_SENDINGS = 1.01
_ROUND_TRIP = 0.001
_MOST_NOISE = 20  # bytes
_PAUSE = 0.5
"""Seconds that no query is to take on a board that only loses responses."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """What becomes of a response; chances."""

    name: str
    lost: float = 0.0
    flipped: float = 0.0
    """One bit of it is."""
    noise: float = 0.0
    """Of some bytes before it."""
    late: float = 0.0
    late_by: tuple[float, float] = (0.2, 2.0)
    """Seconds, for which it also holds up what follows."""
    answered: float = 0.0
    """The goal: of the queries."""
    opened: float = 0.0
    """The goal: of the openings."""


GOOD = Trouble("good, 0.1 % late by up to 0.3 s", late=0.001, late_by=(0.0, 0.3), answered=1.0, opened=1.0)
LOSSY = Trouble("10 % lost", lost=0.1, answered=0.9999, opened=0.99)
MIX = Trouble("the mix", lost=0.1, flipped=0.15, noise=0.3, late=0.1, answered=0.98, opened=0.95)
TROUBLES = (
    GOOD,
    Trouble("10 % late by up to 0.8 s", late=0.1, late_by=(0.0, 0.8), answered=0.9999, opened=0.99),
    LOSSY,
    Trouble("20 % lost", lost=0.2, answered=0.9999, opened=0.99),
    MIX,
)


class TroubledTransport(BaseTransport):
    """A board that answers from a table, in order, as far as the trouble permits."""

    def __init__(self, trouble: Trouble, random: Random) -> None:
        """Draw the trouble from `random`."""
        super().__init__("troubled://")
        self._trouble, self._random = trouble, random
        self._answers = answers()
        self._free_at = 0.0
        self._coming: deque[bytes] = deque()  # timers for the same moment come in any order
        self.sent: Counter[int] = Counter()
        """Requests by packet id."""

    async def _open(self) -> None:
        self._loop = asyncio.get_running_loop()

    def _send(self, data: bytes) -> None:
        for packet_id, _ in requests(data):
            self.sent[packet_id] += 1
            self._answer(self._answers.get(packet_id, b""))

    def _answer(self, answer: bytes) -> None:
        trouble, random = self._trouble, self._random
        late = random.uniform(*trouble.late_by) if random.random() < trouble.late else 0.0
        self._free_at = max(self._free_at, self._loop.time() + _ROUND_TRIP + late)
        if random.random() < trouble.lost:
            return
        if answer and random.random() < trouble.flipped:
            at = random.randrange(len(answer))
            answer = answer[:at] + bytes([answer[at] ^ 1 << random.randrange(8)]) + answer[at + 1 :]
        if random.random() < trouble.noise:
            answer = random.randbytes(random.randrange(1, _MOST_NOISE)) + answer
        self._coming.append(answer)
        self._loop.call_at(self._free_at, lambda: self._deliver(self._coming.popleft()))

    async def _close(self) -> None:
        """Nothing is open."""

    def _abort(self) -> None:
        """Nothing is open."""


async def _ask(trouble: Trouble, depth: int, times: int, seed: int) -> tuple[Counter[str], list[float]]:
    """Open until that succeeds, then ask so many times. Return what came of it, and the seconds of each answer."""
    loop, random = asyncio.get_running_loop(), Random(f"{trouble.name} {depth} {seed}")
    counts: Counter[str] = Counter()
    seconds: list[float] = []
    query = QueryServoRequest(ALL_SERVOS)

    async def ask() -> None:
        while counts["queries"] < times:
            counts["queries"] += 1
            begun = loop.time()
            try:
                await connection.request(query)
            except RequestError:
                counts["failed"] += 1
            seconds.append(loop.time() - begun)

    transport, connection = await _open(trouble, depth, random, counts)
    await asyncio.gather(*(ask() for _ in range(depth)))
    await connection.close()
    counts["sendings"] = transport.sent[query.packet_id]
    counts["fences"] = connection.stats.fences
    return counts, seconds


async def _open(
    trouble: Trouble, depth: int, random: Random, counts: Counter[str]
) -> tuple[TroubledTransport, Connection]:
    loop = asyncio.get_running_loop()
    while True:
        transport = TroubledTransport(trouble, random)
        connection = Connection(transport, ConnectionOptions(depth=depth), learn=False, random=random)
        begun = loop.time()
        counts["openings"] += 1
        await connection.open()
        try:
            await connection.shake_hands()
        except OpenError:
            counts["not opened"] += 1
            await connection.close()
        else:
            return transport, connection
        finally:
            counts["microseconds of opening"] += round((loop.time() - begun) * 1e6)


def outcome(trouble: Trouble, depth: int, times: int, seed: int) -> tuple[Counter[str], list[float]]:
    """Return what came of so many queries on one connection, in virtual time, and their seconds in order."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        counts, seconds = runner.run(_ask(trouble, depth, times, seed))
    return counts, sorted(seconds)


def run(*, short: bool) -> Result:
    """Ask 20,000 times (short: 1,000) on each line, a few times on each connection, at depth 1."""
    queries = 1_000 if short else 20_000
    rows, goals, figures = [], [], {}
    for trouble in TROUBLES:
        connections = [outcome(trouble, 1, _ON_EACH, seed) for seed in range(queries // _ON_EACH)]
        counts = sum((each for each, _ in connections), Counter[str]())
        seconds = sorted(each for _, of_one in connections for each in of_one)
        answered = 1 - counts["failed"] / counts["queries"]
        opened = 1 - counts["not opened"] / counts["openings"]
        pauses = sum(each > _PAUSE for each in seconds)
        figures[trouble.name] = {**counts, "pauses": pauses, "longest": seconds[-1]}
        goals.append(at_least(f"queries answered, {trouble.name}", answered, trouble.answered, "{:.2%}"))
        goals.append(at_least(f"openings, {trouble.name}", opened, trouble.opened, "{:.1%}"))
        if trouble is GOOD:
            sendings = counts["sendings"] / counts["queries"]
            goals.append(at_most("sendings of a query on a good line", sendings, _SENDINGS, "{:.3f}"))
        rows.append(
            (
                trouble.name,
                f"{counts['queries']:,}",
                f"{answered:.2%}",
                f"{counts['sendings'] / counts['queries']:.3f}",
                f"{seconds[len(seconds) * 99 // 100]:.2f} s",
                f"{seconds[-1]:.2f} s",
                f"{pauses:,}",
                f"{opened:.1%}",
                f"{counts['microseconds of opening'] / counts['openings'] / 1e6:.2f} s",
            )
        )
    quote = table(
        "queries on a board that answers within a millisecond, on bad lines",
        ("line", "queries", "answered", "sendings", "99 %", "longest", "over 0.5 s", "opened", "opening"),
        rows,
        notes=[
            f"{_ON_EACH} queries on each connection, one at a time; `opening`: the average time of one",
            "the mix: 10 % lost, 10 % late by 0.2 to 2 s, 15 % with a wrong bit, 30 % behind up to 19 bytes of noise",
        ],
    )
    wrong = [sentence(goal) for goal in missed(goals)]
    return {"tables": [quote], "wrong": wrong, "goals": goals, "figures": figures}
