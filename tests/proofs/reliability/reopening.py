"""Programs that begin where another one was killed, while the board still owes responses to that one."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from random import Random

from benchmarks.measuring import Result, table
from servolink.connection import FENCES
from servolink.errors import ConnectionLost, OpenError, OutcomeUnknown
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    QueryServoRequest,
    Request,
    Step,
)
from tests.proofs.reliability.board import BOARDS, Character
from tests.proofs.reliability.checker import CALL, Call
from tests.proofs.reliability.clock import SimulatedLoop
from tests.proofs.reliability.conversation import STOP, drawn
from tests.proofs.reliability.history import DirectTransport
from tests.proofs.reliability.line import Line
from tests.proofs.reliability.stage import Scene, Stage

_BUSY, _LESS_BUSY = Character("busy", late=0.3), Character("less busy", late=0.1)  # with what they owe
_CALLS = 3  # of the second program
_AT_ONCE = 500  # openings in one task of a process


def _any_kind(random: Random) -> Packet:
    while not isinstance(packet := drawn(random), Request):
        pass
    return packet


_STOPS = "stops and movements"
_READING = QueryServoRequest(ALL_SERVOS)
_KINDS: dict[str, Callable[[Random], Packet]] = {
    "any": _any_kind,
    "those of the handshake": lambda random: random.choice(FENCES),
    _STOPS: lambda random: random.choice(
        (STOP, _READING, ExecuteActionRequest((Step(1, 90, 20),)), ExecuteMacroRequest(1))
    ),
}


@dataclass(frozen=True, slots=True)
class Owed:
    """What the killed program has left behind: so many requests, at least and at most."""

    least: int
    most: int
    kinds: str
    weight: float
    """Openings, as a share of those asked for."""
    stops: bool = False
    """Whether the next program stops the servos before it does anything else."""

    @property
    def name(self) -> str:
        """How it is called in tables."""
        return f"{self.least} to {self.most}" if self.most > self.least else str(self.most)


_OWED = (
    Owed(0, 0, "any", 0.05),
    Owed(1, 5, "any", 0.5),
    Owed(1, 5, "those of the handshake", 0.5),
    Owed(1, 5, _STOPS, 0.5, stops=True),
    Owed(6, 32, "any", 0.2),
    Owed(8, 8, "those of the handshake", 0.2),
    Owed(16, 16, "those of the handshake", 0.2),
    Owed(32, 32, "those of the handshake", 0.2),
)
_FEW = 5  # owed responses, with which no opening may be wrong


async def _open(owed: Owed, times: int, seed: int) -> Counter[str]:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    random = Random(f"reopening {owed} {seed}")
    counts: Counter[str] = Counter()
    for _ in range(times):
        stage = Stage(
            Scene(random.getrandbits(32), Line("clean"), _BUSY if owed.most <= _FEW else _LESS_BUSY),
            loop,
            lambda board: DirectTransport(board, loop),
        )
        asked = [_KINDS[owed.kinds](random) for _ in range(random.randint(owed.least, owed.most))]
        _kill_after(stage, asked, loop)
        begun = loop.now
        counts["openings"] += 1
        try:
            await (_stop_first(stage, counts) if owed.stops else stage.open_once())
        except (OpenError, ConnectionLost):
            counts["not opened"] += 1
        else:
            counts["wrong openings"] += not _is_right(stage, loop.now)
            counts["sendings"] += stage.checker.number - len(asked)
            counts["microseconds"] += round((loop.now - begun) * 1e6)
            for _ in range(_CALLS):
                await stage.conversation.do(Call(0, _any_kind(random)))
            counts["fooled"] += bool(stage.checker.counts["wrong"] + stage.checker.counts["stale"])
            await stage.disconnect()
        await asyncio.sleep(max(0.0, stage.board.free_at - loop.now) + 0.1)
    return counts


async def _stop_first(stage: Stage, counts: Counter[str]) -> None:
    """Open with a stop, which must be the first frame on the line, and read the servos."""
    stop, before = Call(0, STOP, is_stop=True), stage.checker.number
    stop.begun = before
    CALL.set(stop)
    await stage.begin_opening()
    try:
        await stage.connected.stop()
    except OutcomeUnknown:
        counts["unconfirmed stops"] += 1
    finally:
        counts["stops that waited"] += stop.sent[:1] != [before + 1] or not stop.executed
    await stage.conversation.do(Call(0, _READING))


def _kill_after(stage: Stage, asked: list[Packet], loop: SimulatedLoop) -> None:
    """Ask, and be gone."""
    for packet in asked:
        frame = stage.codec.encode(packet)
        number = stage.checker.sends(packet, loop.now, 0.0, None)
        stage.board.receive(stage.board.carry(packet.packet_id, frame, number))
    stage.board.character = BOARDS[0]  # prompt from now on


def _is_right(stage: Stage, now: float) -> bool:
    """Return whether the connection knows of each response that is still to come."""
    waiting: list[Packet] = [slot.request for slot in stage.link.slots._order]
    known = iter(waiting)
    sendings = stage.checker.sendings.values()
    return all(sending.packet in known for sending in sendings if (sending.answer_arrives or 0.0) > now)


def open_often(owed: Owed, times: int, seed: int) -> Counter[str]:
    """Open so many times, and count what came of it."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(_open(owed, times, seed))


def run(*, short: bool, openings: int | None = None, seed: int = 1) -> Result:
    """Open 100,000 times (short: 1,000) for each number of owed responses, or a share of that."""
    openings = openings or (1_000 if short else 100_000)
    rows, figures, wrong = [], {}, []
    with ProcessPoolExecutor() as processes:
        for owed in _OWED:
            times = round(openings * owed.weight)
            chunks = [min(_AT_ONCE, times - at) for at in range(0, times, _AT_ONCE)]
            count = len(chunks)
            done = processes.map(open_often, [owed] * count, chunks, range(seed, seed + count))
            counts = sum(done, Counter[str]())
            opened = counts["openings"] - counts["not opened"]
            figures[f"{owed.name}, {owed.kinds}"] = dict(counts)
            rows.append(
                (
                    owed.name,
                    owed.kinds,
                    f"{counts['openings']:,}",
                    f"{counts['not opened']:,}",
                    f"{counts['wrong openings']:,}",
                    f"{counts['fooled']:,}",
                    f"{counts['sendings'] / opened:.1f}",
                    f"{counts['microseconds'] / opened / 1e6:.2f} s",
                    f"{counts['stops that waited']:,}, {counts['unconfirmed stops']:,}" if owed.stops else "",
                )
            )
            if owed.most <= _FEW and counts["wrong openings"] + counts["fooled"]:
                wrong.append(f"{counts['wrong openings']} wrong openings with {owed.name} owed responses")
            if counts["stops that waited"]:
                wrong.append(f"{counts['stops that waited']} stops were not the first frame on the line")
    quote = table(
        "programs that start while the board owes responses to one that was killed",
        ("owed", "of kinds", "openings", "given up", "wrong", "got a wrong response", "queries", "time", "stops"),
        rows,
        notes=[
            "3 of 10 owed responses (more than five: 1 of 10) are late by 0.1 to 1.5 s, and hold up those behind them",
            "`given up`: the handshake was not complete after 12 s; `wrong`: opened while a response was still owed",
            "`got a wrong response`: in the three requests that follow; `queries` and `time`: averages of an opening",
            "`stops`: the program begins with a stop; how many were not sent and done first, how many not confirmed",
        ],
    )
    return {"tables": [quote], "wrong": wrong, "figures": figures}
