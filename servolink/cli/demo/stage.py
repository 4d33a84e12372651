"""How the demo is shown: as text that a person follows, or as one JSON object for each step."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

from servolink.cli.motion import Draw, live_bars
from servolink.cli.output import Table, is_terminal, print_json, print_table, print_text
from servolink.client.servos import Servo

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
