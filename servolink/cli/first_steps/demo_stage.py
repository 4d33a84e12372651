"""Stage of the demo: the boards, a line with faults, and the output as text or as JSON."""

from __future__ import annotations

import asyncio
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from servolink.cli.screen.live import Draw, follow, live_bars
from servolink.cli.screen.output import Table, console, is_terminal, print_json, print_table, print_text
from servolink.client.board import Board
from servolink.client.servo_state import Servo
from servolink.protocol.records import Action, Step
from servolink.transports.base import Transport
from servolink.transports.lifecycle import WrappedTransport
from servolink.virtual.board import VirtualBoard

_SAMPLE = 0.5  # seconds between the lines that stand for a moving picture
_READING = 0.5  # seconds to read what a step has shown
_INDENT = "   "


@dataclass
class StageResult:
    """Result of a step: measurements and checks."""

    measured: dict[str, Any] = field(default_factory=dict)
    checks: dict[str, bool] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether all checks passed."""
        return all(self.checks.values())


class Stage:
    """Shows the steps as text, or as JSON, which has only their outcomes; `fast` leaves no time to read."""

    def __init__(self, *, as_json: bool, fast: bool) -> None:
        self._as_json = as_json
        self._fast = fast
        self._number = 0

    def begin(self, title: str) -> None:
        """Announce a step."""
        self._number += 1
        self._print("")
        self._print(f"{self._number}. {title}", "bold")

    def say(self, text: str) -> None:
        """Show what happens in a step."""
        self._print(_INDENT + text)

    def table(self, table: Table) -> None:
        """Show a table."""
        if not self._as_json:
            print_table(table)

    @contextmanager
    def motion(self) -> Iterator[Draw]:
        """Show moving servos: bars on a terminal, elsewhere a line now and then."""
        if self._as_json or is_terminal():
            with live_bars(shown=not self._as_json) as bars:
                yield bars
        else:
            self.say("time, then the angle of each servo")
            last: list[tuple[float, Sequence[Servo]]] = []
            written = -_SAMPLE

            def draw(elapsed: float, servos: Sequence[Servo]) -> None:
                nonlocal written
                last[:] = [(elapsed, servos)]
                if elapsed >= written + _SAMPLE:
                    written = elapsed
                    _print_angles(*last.pop())

            yield draw
            if last:
                _print_angles(*last.pop())

    async def finish(self, name: str, outcome: StageResult) -> None:
        """Show the outcome of a step and leave time to read."""
        if self._as_json:
            print_json({"step": name, "ok": outcome.ok, "checks": outcome.checks, "measured": outcome.measured})
            return
        for claim, true in outcome.checks.items():
            self._print(f"{_INDENT}{'ok' if true else 'FAILED'}: {claim}", "green" if true else "bold red")
        if not self._fast:
            await asyncio.sleep(_READING)

    def end(self, result: dict[str, Any]) -> None:
        """Show the result of the demo and the commands to try next: `ok`, `failed`, `seconds`, `next`."""
        if self._as_json:
            print_json({"step": "end", **result})
            return
        told, next_time = f"All of it worked, in {result['seconds']:.1f} s.", "Try next"
        if not result["ok"]:
            told, next_time = f"FAILED: {', '.join(result['failed'])}.", "To look closer"
        self._print("")
        self._print(f"{told} {next_time}, the first in a terminal of its own:")
        for command in result["next"]:
            self._print(_INDENT + command, continued=" \\")

    def _print(self, text: str, style: str = "", *, continued: str = "") -> None:
        """Print text; on a terminal, lines are broken between words, at `continued` in a way that can be pasted."""
        if self._as_json:
            return
        lines = [text]
        if is_terminal() and len(text) > console().width:
            wrapper = textwrap.TextWrapper(console().width - len(continued), break_on_hyphens=False)
            wrapper.break_long_words = False  # a path in two could not be copied
            wrapper.subsequent_indent = " " * (len(text) - len(text.lstrip()) + len(continued))
            lines = wrapper.wrap(text)
            lines[:-1] = [line + continued for line in lines[:-1]]
        for line in lines:
            print_text(line, style)


def _print_angles(elapsed: float, servos: Sequence[Servo]) -> None:
    print_text(f"{_INDENT}{elapsed:4.1f} s " + "".join(f"{int(servo.angle):5}" for servo in servos))


class FaultyLine(WrappedTransport):
    """A line without faults until it is told to damage or to hold back the next response, or is pulled out."""

    def __init__(self, inner: Transport) -> None:
        super().__init__(inner)
        self.damaged = 0
        """The number of responses of which a bit was changed."""
        self.held = 0
        """The number of responses that were held back."""
        self._damage = self._hold = self._is_holding = False
        self._chunks: list[bytes] = []

    def damage_next(self) -> None:
        """Change one bit in the middle of the next chunk."""
        self._damage = True

    def hold_next(self) -> None:
        """Hold back the next chunk until `release`; later ones stay behind it, as on any line."""
        self._hold = True

    def release(self) -> None:
        """Pass on what was held back."""
        self._is_holding = False
        held, self._chunks = self._chunks, []
        for chunk in held:
            self._deliver(chunk)

    def pull(self) -> None:
        """Pull the cable now."""
        self._break("the cable was pulled")

    def data(self, chunk: bytes, /) -> None:
        """Pass on `chunk`, altered by the faults."""
        if self._damage:
            self._damage = False
            self.damaged += 1
            middle = len(chunk) // 2
            chunk = chunk[:middle] + bytes([chunk[middle] ^ 0x10]) + chunk[middle + 1 :]
        if self._hold:
            self._hold, self._is_holding = False, True
            self.held += 1
        if self._is_holding:
            self._chunks.append(chunk)
        else:
            self._deliver(chunk)


@dataclass
class Scene:
    """The boards and the client that take part."""

    board: Board
    """The client, with `virtual` at the other end of `line`."""
    virtual: VirtualBoard
    line: FaultyLine
    second: VirtualBoard
    """Another board, at `second_url`."""
    second_url: str
    stage: Stage
    file: Path
    """The project file that the demo writes."""
    pace: float
    """1.0 for movements that a person can follow, less for faster ones."""

    @property
    def angles(self) -> dict[int, int]:
        """The true angles of the virtual board's servos."""
        return {servo_id: round(servo.angle) for servo_id, servo in self.virtual.servos.items()}

    def interval(self, seconds: float) -> int:
        """Return a time in the protocol's units of 10 ms."""
        return max(1, round(seconds * self.pace * 100))

    def action(self, action_id: int, caption: str, angle_of: Callable[[int], float]) -> Action:
        """Return an action that moves each servo to the angle equal to the servo id."""
        interval = self.interval(0.7)
        return Action(action_id, caption, tuple(Step(each, round(angle_of(each)), interval) for each in self.angles))

    async def watch(self, targets: dict[int, int], seconds: float) -> float:
        """Show the servos until all are at `targets`; return the elapsed time in seconds."""
        start = asyncio.get_running_loop().time()
        with self.stage.motion() as draw:
            await follow(self.board, targets, seconds, draw)
        return round(asyncio.get_running_loop().time() - start, 3)

    def counters(self) -> dict[str, int]:
        """Return what the client has counted of the faults on the line."""
        stats = self.board.stats
        counters = {"skipped_bytes": sum(stats.skipped.values())}
        return counters | {each: getattr(stats, each) for each in ("timeouts", "late_responses", "fences", "retries")}

    def counted_since(self, before: dict[str, int]) -> dict[str, int]:
        """Return, and show, what was counted since `before`."""
        since = {name: count - before[name] for name, count in self.counters().items()}
        self.stage.say(", ".join(f"{name.replace('_', ' ')}: {count}" for name, count in since.items()))
        return since
