"""The compiled loops in plain Python: their reference in tests, and their stand-in where none can be compiled."""

from __future__ import annotations

from collections.abc import Callable
from struct import iter_unpack
from typing import Any

from servolink.protocol.caption import decode_caption
from servolink.protocol.frame import HEADER_SIZE, MAGIC, Frame


def collect(data: bytes, at: int, known: dict[bytes, Any], frames: list[Frame], wary: int) -> int:
    """Append the frames that follow each other in `data`, and return where anything else begins."""
    while entry := known.get(data[at : at + HEADER_SIZE]):
        last, packet_id, _, pieces = entry
        frame = data[at : at + last]
        content = frame[HEADER_SIZE:]
        if pieces is False or at + last >= len(data) or sum(frame) & 0xFF != data[at + last]:
            break
        if wary and len(content) >= HEADER_SIZE and MAGIC in content:
            break
        frames.append((packet_id, content))
        wary -= wary > 0
        at += last + 1
    return at


def read_rows(
    content: bytes, start: int, layout: str, record: Callable[..., Any] | None, encoding: str
) -> tuple[Any, ...]:
    """Return a `record` for each row from `start` on, or (None) the only value of each."""
    rows = [
        [decode_caption(value, encoding) if isinstance(value, bytes) else value for value in row]
        for row in iter_unpack(layout, content[start:])
    ]
    return tuple(row[0] if record is None else record(*row) for row in rows)
