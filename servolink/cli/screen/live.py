"""Live displays on a terminal: servos as bars, and the progress of an import or a measurement."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Container, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress
from typing import TYPE_CHECKING, TypeAlias

from servolink.cli.screen.output import Form, angle_text, console, is_terminal
from servolink.cli.screen.terminal import cleanup
from servolink.client import Board, Servo
from servolink.errors import escape
from servolink.project import Phase, ProgressCallback
from servolink.project import Progress as ImportProgress

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID
    from rich.table import Table
    from rich.text import Text

Draw: TypeAlias = "Callable[[float, Sequence[Servo]], None]"
"""Takes the seconds since the start and what the servos then report."""

_HALF = 24  # columns for the widest angle to one side
_BESIDE = 21  # columns for what stands beside a bar, such as "servo 254" and "4095 ADC"
_WIDEST = 120.0
_EVERY = 0.5  # seconds between two looks at what stays


async def follow(board: Board, targets: Mapping[int, int], seconds: float, draw: Draw) -> tuple[Servo, ...]:
    """Draw the servos until all rest at `targets`, and return the last report of the servos (see `Board.follow`)."""
    loop = asyncio.get_running_loop()
    start = loop.time()
    servos: tuple[Servo, ...] = ()
    async for servos in board.follow(targets, seconds, settle=True):
        draw(loop.time() - start, servos)
    return servos


@asynccontextmanager
async def staying_line(status: Callable[[int], tuple[bool, str]]) -> AsyncIterator[Callable[[str, str], None]]:
    """Yield a function that prints a text in a style above a status row, without repeating the latest text.

    `status` is asked twice a second for that line, of as many columns as it is given, and whether all is fine.
    """
    from rich.live import Live
    from rich.text import Text

    displayed = console()
    live = Live(console=displayed, auto_refresh=False, transient=True)
    latest = ""

    def show(text: str, style: str = "") -> None:
        nonlocal latest
        if text and text != latest:  # what is refused once is refused often
            latest = text
            displayed.print(Text(escape(text), style))

    def draw() -> None:
        is_fine, line = status(displayed.width)
        live.update(Text(line, "bold" if is_fine else "bold red"), refresh=True)

    with cleanup(displayed.show_cursor), live:
        async with redrawn(draw, _EVERY):
            yield show


@asynccontextmanager
async def redrawn(draw: Callable[[], None], every: float) -> AsyncIterator[None]:
    """Call `draw` in this context, again after `every` seconds each time."""

    async def repeat() -> None:
        with suppress(OSError):  # closed terminal, with SIGHUP soon to arrive
            while True:
                draw()
                await asyncio.sleep(every)

    drawing = asyncio.create_task(repeat())
    try:
        yield
    finally:
        drawing.cancel()
        with suppress(asyncio.CancelledError):
            await drawing


@contextmanager
def live_bars(servo_ids: Container[int] = range(256), seconds: float = 0.0) -> Iterator[Draw]:
    """Yield a function that draws the servos, or the servos in `servo_ids`, as bars; the last bars stay visible.

    Below them is the time, as a bar too if it is known that it takes `seconds`. Without a terminal nothing is drawn.
    """
    if not is_terminal():
        yield lambda elapsed, servos: None
        return
    from rich.live import Live

    displayed = console()
    block, zero = "█│" if displayed.encoding.startswith("utf") else "#|"
    with cleanup(displayed.show_cursor), Live(console=displayed, auto_refresh=False) as live:

        def draw(elapsed: float, servos: Sequence[Servo]) -> None:
            wanted = [servo for servo in servos if servo.servo_id in servo_ids]
            half = max(0, min(_HALF, (displayed.width - _BESIDE) // 2))
            bars = _bars(wanted, block, zero, half)
            bars.add_row(*_progress(elapsed, seconds, block, half))
            live.update(bars, refresh=True)

        yield draw


def _bars(servos: Sequence[Servo], block: str, zero: str, half: int) -> Table:
    from rich.table import Table
    from rich.text import Text

    bars = Table.grid(padding=(0, 1))
    bars.add_column(justify="right")
    bars.add_column()
    bars.add_column(justify="right")
    for servo in servos:
        length = min(half, round(abs(int(servo.angle)) / _WIDEST * half))
        bar = (block * length).rjust(half) + zero if servo.angle < 0 else " " * half + zero + block * length
        colour = "red" if not (servo.is_start and servo.is_hold) else "cyan" if servo.angle < 0 else "green"
        bars.add_row(
            Text(f"servo {servo.servo_id}"), Text(bar.ljust(2 * half + 1), style=colour), Text(angle_text(servo.angle))
        )
    return bars


def _progress(elapsed: float, seconds: float, block: str, half: int) -> Iterator[Text]:
    """Yield the cells of the row that shows the time."""
    from rich.text import Text

    yield Text(f"{elapsed:.1f} s", style="dim")
    if seconds > 0:
        yield Text(block * round(min(elapsed / seconds, 1.0) * (2 * half + 1)), style="dim")
        yield Text(f"of {seconds:.1f} s", style="dim")


Line: TypeAlias = "tuple[str, str]"
"""Text and rich style of a row."""
Picture: TypeAlias = "Callable[[int, int, bool], list[Line]]"
"""Returns the lines for a width and a height, of ASCII unless it may use block characters."""


def can_draw() -> bool:
    """Return whether standard output is a terminal on which pictures can replace each other."""
    return is_terminal() and not console().is_dumb_terminal


@contextmanager
def pictures(picture: Picture) -> Iterator[Callable[[], None]]:
    """Yield a function that draws `picture` on the alternate screen; the last picture stays on the main screen."""
    from rich.console import Group
    from rich.live import Live
    from rich.text import Text

    displayed = console()
    live = Live(console=displayed, auto_refresh=False, screen=True)
    blocks = displayed.encoding.startswith("utf")

    def leave() -> None:
        if live.is_started:  # the process ends at once
            displayed.set_alt_screen(False)
            displayed.show_cursor()

    def drawn() -> Group:
        lines = picture(displayed.width, displayed.height, blocks)
        return Group(*(Text(text, style, no_wrap=True, overflow="crop") for text, style in lines))

    try:
        with cleanup(leave), live:
            yield lambda: live.update(drawn(), refresh=True)
    finally:
        displayed.print(drawn())


def draws_progress() -> bool:
    """Return whether progress is drawn: on a terminal at standard error, and not with --json."""
    return not Form.json and sys.stderr is not None and sys.stderr.isatty()


_BESIDE_BAR = ("description", "fields[size]", "fields[item]")


@contextmanager
def progress_bar(label: str, total: int | None = None) -> Iterator[tuple[Progress, TaskID]]:
    """Yield a bar on standard error and its task; the fields `item` and `size` of the task stand beside the bar."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    begin, size, item = (TextColumn(f"{{task.{name}}}", markup=False) for name in _BESIDE_BAR)
    columns = (begin, BarColumn(), MofNCompleteColumn(), size, TimeRemainingColumn(), item)
    displayed = console(stderr=True)
    with cleanup(displayed.show_cursor), Progress(*columns, console=displayed, transient=True) as bar:
        yield bar, bar.add_task(label, total=total, item="", size="")


@contextmanager
def counting(label: str, total: int) -> Iterator[Callable[[], None]]:
    """Yield a function to call `total` times; on a terminal, a bar on standard error shows how often it was called."""
    if not draws_progress():
        yield lambda: None
        return
    with progress_bar(label, total) as (bar, task):
        yield lambda: bar.advance(task)


PHASES: dict[Phase, str] = {
    "reading": "reading the board",
    "saving": "keeping a backup",
    "marking": "marking the import on the board",
    "clearing": "deleting all data",
    "writing": "writing",
    "verifying": "verifying",
    "finishing": "finishing",
}


@contextmanager
def shown_progress(board: Board) -> Iterator[ProgressCallback]:
    """Yield a callback that draws a bar on standard error; without a terminal, or with --json, no bar is drawn."""
    if not draws_progress():
        yield lambda progress: None
        return
    phase: Phase | None = None
    with progress_bar(PHASES["reading"]) as (bar, task):

        def update(progress: ImportProgress) -> None:
            nonlocal phase
            if progress.phase != phase:
                phase = progress.phase
                bar.reset(task, description=PHASES[phase], item="", size="")  # one call: no picture lacks the label
            size = f"{board.stats.bytes_sent + board.stats.bytes_received:,} bytes"
            bar.update(task, completed=progress.done, total=progress.total, item=escape(progress.item), size=size)

        yield update
