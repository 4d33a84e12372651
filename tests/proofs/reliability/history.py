"""One seed, one history: a connection, callers, a line and a board, to the last bit.

All is drawn from the seed, and nothing from anywhere else.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from dataclasses import dataclass, field

from servolink.transports import Receiver
from tests.proofs.reliability.board import SimulatedBoard
from tests.proofs.reliability.clock import Deadlock, SimulatedLoop
from tests.proofs.reliability.stage import Scene, Stage

STEPS = 2000
"""Calls in a history."""


@dataclass(slots=True)
class History:
    """What happened."""

    scene: Scene
    counts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    digest: str = ""
    """The same only for the same history."""
    seconds: float = 0.0
    """Virtual ones."""
    latest: deque[tuple[float, str, bytes | str]] = field(default_factory=deque)
    """The last events before the first fault, or before the end."""


class DirectTransport:
    """Straight to the simulated board, and from it over the device of the simulated loop."""

    url = "simulated://board"

    def __init__(self, board: SimulatedBoard, loop: SimulatedLoop) -> None:
        """Lead to `board`."""
        self._board, self._loop = board, loop
        self._receiver: Receiver | None = None

    async def open(self, receiver: Receiver) -> None:
        """Read from now on; what came before is dropped, as the opening of a serial port does."""
        self._receiver = receiver
        self._loop.read_device(receiver.data)

    async def send(self, data: bytes) -> None:
        """Let the board have `data` at once."""
        self._board.receive(data)

    async def close(self) -> None:
        """End the connection."""
        self._loop.read_device(lambda data: None)
        if self._receiver is not None:
            self._receiver.lost(None)
            self._receiver = None


def relive(seed: int, steps: int = STEPS) -> History:
    """Return the history of `seed`."""
    history = History(Scene.of(seed))
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        try:
            runner.run(_live(history, steps))
        except Deadlock as error:
            history.faults.append(f"deadlock: {error}")
    return history


async def _live(history: History, steps: int) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SimulatedLoop)
    stage = Stage(history.scene, loop, lambda board: DirectTransport(board, loop))
    checker, begun = stage.checker, loop.now
    history.faults, history.latest = checker.faults, checker.latest
    await stage.connect()
    await stage.conversation.hold(history.scene.callers, steps)
    await stage.come_to_rest()
    await stage.disconnect()
    await asyncio.sleep(0)
    if left := asyncio.all_tasks() - {asyncio.current_task()}:
        checker.fault(steps, f"{len(left)} tasks are left")
    missed = stage.board.to_host.missed
    if missed and not history.scene.line.damages and not checker.counts["lost"]:  # what comes meanwhile is dropped
        checker.fault(steps, f"{missed} answers arrived whole and were not found")
    history.counts.update(checker.counts)
    history.counts.update(stage.stats)
    history.counts["unknown and done"] = sum(call.executed > 0 for call in checker.unknown)
    history.counts.update(calls=stage.conversation.calls, sendings=checker.number, missed=missed)
    history.digest, history.seconds = checker.digest, loop.now - begun
