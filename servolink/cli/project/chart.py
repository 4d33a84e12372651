"""A chart of who moves when: a row for each servo, time from left to right, as plain text."""

from __future__ import annotations

from collections.abc import Mapping

from servolink.cli.output import Table, plain_lines, text_width
from servolink.virtual.rehearsal import Move, Timeline

_NARROWEST, _WIDEST = 20, 1000
_BETWEEN_TICKS = 8
"""Columns that two labels of the axis have at least."""
_STEPS = (1, 2, 5)


def chart(timeline: Timeline, captions: Mapping[int, str], width: int) -> list[str]:
    """Return the lines of a chart `width` columns wide, within reason: that of a pipe is what COLUMNS says.

    `[60===]` is a movement to 60 degrees, `[60==>` one that the next or the end cuts short, `|` one too short to draw.
    """
    moved = sorted({move.servo_id for move in timeline.moves})
    rows = {servo_id: (servo_id, captions.get(servo_id, "")) for servo_id in moved}
    labels = plain_lines(Table(("servo", ""), list(rows.values())))
    columns = min(_WIDEST, max(_NARROWEST, width - max(map(text_width, labels)) - 2))
    scale = (columns - 1) / max(timeline.seconds, 0.01)
    bars = {servo_id: [" "] * columns for servo_id in rows}
    for move in timeline.moves:
        _draw(bars[move.servo_id], move, scale)
    table = [(*row, "".join(bars[servo_id])) for servo_id, row in rows.items()]
    return plain_lines(Table(("servo", "", _axis(timeline.seconds, scale, columns)), table))


def _draw(row: list[str], move: Move, scale: float) -> None:
    start, end = round(move.start * scale), min(round(move.end * scale), len(row))
    size = end - start
    if size < 2:
        row[start] = "|"
        return
    label = str(move.target)
    inside = label.ljust(size - 2, "=") if len(label) <= size - 2 else "=" * (size - 2)
    row[start:end] = f"[{inside}{'>' if move.is_cut or end == len(row) else ']'}"


def _axis(seconds: float, scale: float, columns: int) -> str:
    """Return `0 s     0.5     1`, with labels where they belong."""
    steps = (step * 10.0**power for power in range(-3, 10) for step in _STEPS)
    tick = next(step for step in steps if step * scale >= _BETWEEN_TICKS)
    axis = [" "] * columns
    count = int(seconds / tick + 1e-9)
    for number in range(count + 1):
        label = f"{number * tick:g}" + (" s" if number == 0 else "")
        at = min(round(number * tick * scale), columns - len(label))
        axis[at : at + len(label)] = label
    return "".join(axis)
