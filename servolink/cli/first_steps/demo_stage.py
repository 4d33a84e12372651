"""Stage of the demo: the boards, a line with faults, and the output while a step is played."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import TextWrapper

from servolink.cli.screen.live import Draw, follow, live_bars
from servolink.cli.screen.output import console, is_terminal
from servolink.cli.screen.result import Part, print_for_people
from servolink.client import Board, Servo
from servolink.protocol import Action, Step
from servolink.transports import Transport, WrappedTransport
from servolink.virtual import VirtualBoard

_SAMPLE = 0.5  # seconds between the lines that stand for a moving picture
INDENT = "   "


def told(text: str, style: str = "", *, continued: str = "") -> list[Part]:
    """Return the lines of a text, broken between words on a terminal, and at `continued` so that they can be pasted."""
    lines = [text]
    if is_terminal() and len(text) > console().width:
        wrapper = TextWrapper(console().width - len(continued), break_on_hyphens=False, break_long_words=False)
        wrapper.subsequent_indent = " " * (len(text) - len(text.lstrip()) + len(continued))
        *begun, last = wrapper.wrap(text)
        lines = [*(line + continued for line in begun), last]
    return [(line, style) for line in lines]


def say(text: str) -> None:
    """Print what happens in a step."""
    print_for_people(told(INDENT + text))


@contextmanager
def _motion() -> Iterator[Draw]:
    """Show moving servos: bars on a terminal, elsewhere a line now and then."""
    if is_terminal():
        with live_bars() as bars:
            yield bars
        return
    say("time, then the angle of each servo")
    shown, waiting = -_SAMPLE, list[str]()

    def draw(elapsed: float, servos: Sequence[Servo]) -> None:
        nonlocal shown
        waiting[:] = [f"{INDENT}{elapsed:4.1f} s " + "".join(f"{int(servo.angle):5}" for servo in servos)]
        if elapsed >= shown + _SAMPLE:
            shown = elapsed
            print_for_people(waiting.pop())

    yield draw
    print_for_people(waiting)


class FaultyLine(WrappedTransport):
    """A line without faults until it is told to damage or to hold back the next response, or is pulled out."""

    def __init__(self, inner: Transport) -> None:
        super().__init__(inner)
        self.damaged = self.held = 0
        """The numbers of responses of which a bit was changed, and that were held back."""
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
            middle = len(chunk) // 2
            chunk = chunk[:middle] + bytes([chunk[middle] ^ 0x10]) + chunk[middle + 1 :]
        self.damaged += self._damage
        self.held += self._hold
        self._is_holding |= self._hold
        self._damage = self._hold = False
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
    file: Path
    """The project file that the demo writes."""
    pace: float
    """1.0 for movements that a person can follow, less for faster ones."""
    checks: dict[str, bool] = field(default_factory=dict)
    """Claims of the step that is played, and whether each is true."""

    def check(self, claim: str, true: bool) -> None:  # noqa: FBT001 - as in an assertion
        """Note whether a claim is true."""
        self.checks[claim] = true

    @property
    def angles(self) -> dict[int, int]:
        """The true angles of the virtual board's servos."""
        return {servo_id: round(servo.angle) for servo_id, servo in self.virtual.servos.items()}

    def interval(self, seconds: float) -> int:
        """Return a time in the protocol's units of 10 ms."""
        return max(1, round(seconds * self.pace * 100))

    def action(self, action_id: int, caption: str, angle_of: Callable[[int], float]) -> Action:
        """Return an action that moves each servo to the angle that `angle_of` returns for its id."""
        interval = self.interval(0.7)
        return Action(action_id, caption, tuple(Step(each, round(angle_of(each)), interval) for each in self.angles))

    async def watch(self, targets: dict[int, int], seconds: float) -> float:
        """Show the servos until all are at `targets`; return the elapsed time in seconds."""
        start = asyncio.get_running_loop().time()
        with _motion() as draw:
            await follow(self.board, targets, seconds, draw)
        return round(asyncio.get_running_loop().time() - start, 3)

    @contextmanager
    def counted(self) -> Iterator[dict[str, int]]:
        """Yield what the client counts of the faults on the line in this context; print it at the end."""
        before, since = self._counters(), dict[str, int]()
        yield since
        since |= {name: count - before[name] for name, count in self._counters().items()}
        say(", ".join(f"{name.replace('_', ' ')}: {count}" for name, count in since.items()))

    def _counters(self) -> dict[str, int]:
        stats = self.board.stats
        counters = {"skipped_bytes": sum(stats.skipped.values())}
        return counters | {each: getattr(stats, each) for each in ("timeouts", "late_responses", "fences", "retries")}
