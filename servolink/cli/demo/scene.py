"""Who and what the steps of the demo need."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path

from servolink.cli.demo.line import FaultyLine
from servolink.cli.demo.stage import Stage
from servolink.cli.motion import follow
from servolink.client.board import Board
from servolink.virtual.board import VirtualBoard


@dataclass
class Scene:
    """Who plays, and where."""

    board: Board
    """The client's, with `virtual` behind `line`."""
    virtual: VirtualBoard
    line: FaultyLine
    second: VirtualBoard
    """Another one, at `second_url`."""
    second_url: str
    stage: Stage
    folder: Path
    """Where files are written."""
    pace: float
    """1.0 for movements that a person can follow, less for faster ones."""

    def interval(self, seconds: float) -> int:
        """Return a time in the protocol's units of 10 ms."""
        return max(1, round(seconds * self.pace * 100))

    async def watch(self, targets: dict[int, int], seconds: float) -> float:
        """Show the servos until they are at `targets`; return how long that took."""
        start = asyncio.get_running_loop().time()
        with self.stage.motion() as draw:
            await follow(self.board, targets, seconds, draw)
        return round(asyncio.get_running_loop().time() - start, 3)

    def counters(self) -> dict[str, int]:
        """Return what the client has counted of the faults on the line."""
        stats = self.board.stats
        return {
            "skipped_bytes": sum(stats.skipped.values()),
            "timeouts": stats.timeouts,
            "late_replies": stats.late_replies,
            "fences": stats.fences,
            "retries": stats.retries,
        }

    def counted(self, before: dict[str, int]) -> dict[str, int]:
        """Return, and show, what was counted since `before`."""
        now = self.counters()
        since = {name: now[name] - before[name] for name in now}
        self.stage.say(", ".join(f"{name.replace('_', ' ')}: {count}" for name, count in since.items()))
        return since
