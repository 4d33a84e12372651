"""The line that `servolink record` keeps up to date on a terminal."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING

from servolink.cli.output import console, text_width
from servolink.cli.terminal import cleanup
from servolink.escaping import escape

if TYPE_CHECKING:
    from servolink.recorder.recorder import Recorder
    from servolink.recorder.writer import RecorderStatus

_EVERY = 0.5  # seconds
_KIB = 1024


async def status_lines(recorder: Recorder) -> None:
    """Show how a recording goes on, until the task is cancelled."""
    from rich.live import Live
    from rich.text import Text

    displayed = console(stderr=True)
    live = Live(console=displayed, auto_refresh=False, transient=True)
    with cleanup(displayed.show_cursor), suppress(OSError), live:  # OSError: the terminal is gone
        while True:
            status = recorder.status
            style = "bold red" if status.problem or status.dropped else "bold"
            live.update(Text(status_line(status, displayed.width), style), refresh=True)
            await asyncio.sleep(_EVERY)


def status_line(status: RecorderStatus, width: int) -> str:
    """Return the line, cut to `width` columns."""
    minutes, seconds = divmod(int(status.seconds), 60)
    parts = [
        f"{minutes}:{seconds:02}",
        f"{status.messages:,} messages",
        _size(status.size),
        *([f"{status.dropped:,} missing"] if status.dropped else []),
        *([f"nothing can be written: {status.problem}"] if status.problem else []),
        "m: mark  q: end",
    ]
    text = escape("  ".join(parts))
    while text_width(text) > width:
        text = text[:-1]
    return text


def _size(size: int) -> str:
    return f"{size / _KIB:,.0f} KiB" if size < _KIB * _KIB else f"{size / _KIB / _KIB:,.1f} MiB"
