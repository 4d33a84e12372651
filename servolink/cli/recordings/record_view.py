"""Output of `servolink record` while recording: a status row on a terminal, and the files written from a ring."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Self

from servolink.cli.screen.output import console, counted, cut, text_width
from servolink.cli.screen.result import CommandResult, show
from servolink.cli.screen.terminal import cleanup
from servolink.errors import escape
from servolink.recorder import Recorder, RecorderStatus

_EVERY = 0.5  # seconds
_KIB = 1024


class RingSaved(CommandResult, frozen=True):
    """JSON of each file that `record` with --ring writes."""

    saved: str
    reason: str
    size_bytes: int


class RecordingEnded(CommandResult, frozen=True):
    """JSON of the last line of `record`: what was recorded."""

    path: str
    seconds: float
    size_bytes: int
    messages: int
    dropped: int

    @classmethod
    def of(cls, status: RecorderStatus) -> Self:
        """Return what was recorded."""
        return cls(status.path, round(status.seconds, 3), status.size, status.messages, status.dropped)


class RecordView:
    """Shows one recording."""

    def __init__(self, recorder: Recorder, *, on_screen: bool) -> None:
        """Draw a line that stays if `on_screen`."""
        self._recorder = recorder
        self._is_ring = recorder.wanted.ring is not None
        self._on_screen = on_screen
        self._told = 0  # files of a ring

    async def run(self) -> None:
        """Show the state of the recording until the task is cancelled."""
        with suppress(OSError), self._screen() as draw:  # OSError: the terminal is gone
            while True:
                draw(self._recorder.status)
                await asyncio.sleep(_EVERY)

    def end(self) -> str:
        """Print pending remarks, and return a sentence about the recording."""
        status = self._recorder.status
        self._show_saved(status)
        show(RecordingEnded.of(status))
        return summary(status, is_ring=self._is_ring)

    def unfinished(self) -> str:
        """Return a sentence about the recording so far, for a process that ends before all data is written."""
        status = self._recorder.status
        text = summary(status, is_ring=self._is_ring)
        if self._is_ring:
            return f"{text}; a failure of the last seconds may not be written"
        return f"{text}; its end may be missing, and `servolink record {status.path} --repair` mends it"

    @contextmanager
    def _screen(self) -> Iterator[Callable[[RecorderStatus], None]]:
        if not self._on_screen:
            yield self._show_saved
            return
        from rich.live import Live
        from rich.text import Text

        displayed = console(stderr=True)
        live = Live(console=displayed, auto_refresh=False, transient=True)

        def draw(status: RecorderStatus) -> None:
            self._show_saved(status, lambda _, text: displayed.print(Text(escape(text))))
            style = "bold red" if status.problem or status.dropped else "bold"
            live.update(Text(status_line(status, displayed.width, is_ring=self._is_ring), style), refresh=True)

        with cleanup(displayed.show_cursor), live:
            yield draw

    def _show_saved(self, status: RecorderStatus, say: Callable[[RingSaved, str], None] = show) -> None:
        for saved in status.saved[self._told :]:
            say(RingSaved(saved.path, saved.reason, saved.size), f"wrote {saved.path}: {saved.reason}")
        self._told = len(status.saved)


def status_line(status: RecorderStatus, width: int, *, is_ring: bool = False) -> str:
    """Return the status row, without keys on a narrow terminal, and cut to `width` columns."""
    minutes, seconds = divmod(int(status.seconds), 60)
    parts = [
        f"{minutes}:{seconds:02}{' in memory' if is_ring else ''}",
        f"{status.messages:,} messages",
        _size(status.size),
        *([f"{status.dropped:,} missing"] if status.dropped else []),
        *([f"nothing can be written: {status.problem}"] if status.problem else []),
    ]
    text, keys = escape("  ".join(parts)), f"  m: mark{'  w: write' if is_ring else ''}  q: end"
    if text_width(text + keys) <= width:
        return text + keys
    return cut(text, width)


def summary(status: RecorderStatus, *, is_ring: bool) -> str:
    """Return in a sentence what was recorded."""
    text = f"recorded {counted(status.messages, 'message')} in {status.seconds:.1f} s to {status.path}"
    if is_ring:
        text = _summary_of_ring(status)
    if status.dropped:
        text += f"; {counted(status.dropped, 'message')} missing, because the disk was too slow or full"
    return text


def _summary_of_ring(status: RecorderStatus) -> str:
    """Return in a sentence which files were written of a ring."""
    saved = status.saved
    if not saved:
        return "nothing failed, and nothing was written"
    last = saved[-1].path
    wrote = f"wrote {last}" if len(saved) == 1 else f"wrote {len(saved)} files, the last one {last}"
    return f"{wrote}; nothing has failed since, and what came since was not kept"


def _size(size: int) -> str:
    return f"{size / _KIB:,.0f} KiB" if size < _KIB * _KIB else f"{size / _KIB / _KIB:,.1f} MiB"
