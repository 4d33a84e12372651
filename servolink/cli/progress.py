"""How far an export or an import is: a bar on a terminal, else one line for each phase."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from servolink.cli.output import console
from servolink.client.board import Board
from servolink.printable import printable
from servolink.project.imports.progress import Phase, Progress, Tell

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
def shown_progress(board: Board, *, quiet: bool) -> Iterator[Tell]:
    """Yield what takes the progress and shows it on standard error, not at all if `quiet`."""
    if quiet:
        yield lambda progress: None
    elif sys.stderr is not None and sys.stderr.isatty():
        with _bar(board) as tell:
            yield tell
    else:
        yield _lines()


@contextmanager
def _bar(board: Board) -> Iterator[Tell]:
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[size]}", markup=False),
        TimeRemainingColumn(),
        TextColumn("{task.fields[item]}", markup=False),
    )
    phase: Phase | None = None
    with Bar(*columns, console=console(stderr=True), transient=True) as bar:
        task = bar.add_task("", item="", size="")

        def tell(progress: Progress) -> None:
            nonlocal phase, task
            if progress.phase != phase:
                phase = progress.phase
                bar.remove_task(task)
                task = bar.add_task(PHASES[phase], item="", size="")
            size = f"{board.stats.bytes_sent + board.stats.bytes_received:,} bytes"
            bar.update(task, completed=progress.done, total=progress.total, item=printable(progress.item), size=size)

        yield tell


def _lines() -> Callable[[Progress], None]:
    phase: Phase | None = None

    def tell(progress: Progress) -> None:
        nonlocal phase
        if progress.phase != phase:
            phase = progress.phase
            print(f"{PHASES[phase]} ...", file=sys.stderr, flush=True)

    return tell
