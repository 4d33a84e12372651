"""How the demo is shown: as text that a person follows, or as one JSON object for each step."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from servolink.cli.live import Draw, follow, live_bars
from servolink.cli.output import Table, is_terminal, print_json, print_table, print_text
from servolink.client.board import Board
from servolink.client.servos import Servo
from servolink.transports.base import Transport
from servolink.transports.lifecycle import WrappedTransport
from servolink.virtual.board import VirtualBoard

_SAMPLE = 0.5  # seconds between the lines that stand for a moving picture
_READING = 0.5  # seconds to read what a step has shown


@dataclass
class Outcome:
    """What a step came to: what was measured, and what had to be true."""

    measured: dict[str, Any] = field(default_factory=dict)
    checks: dict[str, bool] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether everything was as it had to be."""
        return all(self.checks.values())


class Stage(Protocol):
    """Where the steps are shown."""

    def begin(self, title: str) -> None:
        """Announce a step."""

    def say(self, text: str) -> None:
        """Tell what happens."""

    def table(self, table: Table) -> None:
        """Show a table."""

    def motion(self) -> Any:
        """Return a context manager that gives a Draw for servos on their way."""

    async def finish(self, name: str, outcome: Outcome) -> None:
        """Show what a step came to."""

    def end(self, described: dict[str, Any]) -> None:
        """Show the end: `ok`, `failed`, `seconds`, `next`."""


class TextStage:
    """Shows the steps to a person; `fast` leaves no time to read."""

    def __init__(self, *, fast: bool) -> None:
        """Begin with the first step."""
        self._fast = fast
        self._number = 0

    def begin(self, title: str) -> None:
        """Announce a step."""
        self._number += 1
        print_text("")
        print_text(f"{self._number}. {title}", "bold")

    def say(self, text: str) -> None:
        """Tell what happens."""
        print_text(f"   {text}")

    def table(self, table: Table) -> None:
        """Show a table."""
        print_table(table)

    @contextmanager
    def motion(self) -> Iterator[Draw]:
        """Draw bars on a terminal, else write a line now and then."""
        if is_terminal():
            with live_bars() as draw:
                yield draw
            return
        print_text("   time, then the angle of each servo")
        samples = _Samples()
        yield samples.draw
        samples.end()

    async def finish(self, name: str, outcome: Outcome) -> None:
        """Show the checks and leave time to read."""
        for claim, true in outcome.checks.items():
            print_text(f"   {'ok' if true else 'FAILED'}: {claim}", "green" if true else "bold red")
        if not self._fast:
            await asyncio.sleep(_READING)

    def end(self, described: dict[str, Any]) -> None:
        """Say how it went and what to try next."""
        print_text("")
        if described["ok"]:
            print_text(
                f"All of it worked, in {described['seconds']:.1f} s. Try next, the first in a terminal of its own:"
            )
        else:
            print_text(f"FAILED: {', '.join(described['failed'])}. To look closer, the first in a terminal of its own:")
        for command in described["next"]:
            print_text(f"   {command}")


class _Samples:
    """Angles over time, as lines."""

    def __init__(self) -> None:
        self._next = 0.0
        self._last: tuple[float, Sequence[Servo]] | None = None

    def draw(self, elapsed: float, servos: Sequence[Servo]) -> None:
        self._last = (elapsed, servos)
        if elapsed >= self._next:
            self._write()
            self._next += _SAMPLE

    def end(self) -> None:
        if self._last is not None:
            self._write()

    def _write(self) -> None:
        if self._last is not None:
            elapsed, servos = self._last
            self._last = None
            print_text(f"   {elapsed:4.1f} s " + "".join(f"{int(servo.angle):5}" for servo in servos))


class JsonStage:
    """Prints one object for each step and one at the end."""

    def begin(self, title: str) -> None:
        """Announce nothing."""

    def say(self, text: str) -> None:
        """Say nothing."""

    def table(self, table: Table) -> None:
        """Show nothing."""

    @contextmanager
    def motion(self) -> Iterator[Draw]:
        """Draw nothing."""
        yield lambda elapsed, servos: None

    async def finish(self, name: str, outcome: Outcome) -> None:
        """Print the step."""
        print_json({"step": name, "ok": outcome.ok, "checks": outcome.checks, "measured": outcome.measured})

    def end(self, described: dict[str, Any]) -> None:
        """Print the end."""
        print_json({"step": "end", **described})


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
            "late_responses": stats.late_responses,
            "fences": stats.fences,
            "retries": stats.retries,
        }

    def counted(self, before: dict[str, int]) -> dict[str, int]:
        """Return, and show, what was counted since `before`."""
        now = self.counters()
        since = {name: now[name] - before[name] for name in now}
        self.stage.say(", ".join(f"{name.replace('_', ' ')}: {count}" for name, count in since.items()))
        return since


class FaultyLine(WrappedTransport):
    """A line that is perfect until it is told to damage or to delay the next reply, or is pulled out."""

    def __init__(self, inner: Transport) -> None:
        """Wrap `inner`."""
        super().__init__(inner)
        self.damaged = 0
        """Replies of which a byte was changed."""
        self.delayed = 0
        """Replies that were held back."""
        self._damage = False
        self._delay = 0.0
        self._held: list[bytes] = []
        self._timer: asyncio.TimerHandle | None = None

    def damage_next(self) -> None:
        """Change one bit in the middle of what comes next."""
        self._damage = True

    def delay_next(self, seconds: float) -> None:
        """Hold back what comes next; whatever comes meanwhile stays behind it, as on any line."""
        self._delay = seconds

    def pull(self) -> None:
        """Be pulled out now."""
        self._break("the cable was pulled")

    def data(self, chunk: bytes, /) -> None:
        """Pass on what comes, or what becomes of it."""
        if self._damage:
            self._damage = False
            self.damaged += 1
            middle = len(chunk) // 2
            chunk = chunk[:middle] + bytes([chunk[middle] ^ 0x10]) + chunk[middle + 1 :]
        if self._delay:
            self.delayed += 1
            self._timer = asyncio.get_running_loop().call_later(self._delay, self._release)
            self._delay = 0.0
        if self._timer is None:
            self._deliver(chunk)
        else:
            self._held.append(chunk)

    async def close(self) -> None:
        """Close the line; what is held back is lost."""
        if self._timer is not None:
            self._timer.cancel()
        await super().close()

    def _release(self) -> None:
        self._timer = None
        held, self._held = self._held, []
        for chunk in held:
            self._deliver(chunk)
