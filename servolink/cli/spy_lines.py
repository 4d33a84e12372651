"""Lines for people, and objects for programs, about what passes."""

from __future__ import annotations

import shutil
from typing import Any

from servolink.cli.output import is_terminal, print_json, print_text, text_width
from servolink.cli.packets import lines_for
from servolink.escaping import escape
from servolink.protocol.json_form import packet_to_json
from servolink.spy.learning import Passed

_WHO = {"sent": "program", "received": "board"}
_LONGEST = 400  # characters of a line where nothing limits it
_SHOWN = 16  # bytes of anything but a packet


class Lines:
    """Shows what passes, one after the other."""

    def __init__(self, *, as_json: bool) -> None:
        """Start; times count from the first."""
        self._as_json = as_json
        self._start: float | None = None

    def show(self, passed: Passed) -> None:
        """Print a line, or with JSON an object."""
        if self._start is None:
            self._start = passed.seconds
        seconds = passed.seconds - self._start
        if self._as_json:
            print_json({"seconds": round(seconds, 6), "from": _WHO[passed.direction], **_described(passed)})
        else:
            line = f"{seconds:9.3f}  {_WHO[passed.direction]:7}  {_text(passed)}"
            print_text(cut(escape(line), shutil.get_terminal_size().columns if is_terminal() else _LONGEST))


def _described(passed: Passed) -> dict[str, Any]:
    seen = passed.seen
    if passed.packet is not None:
        return {**packet_to_json(passed.packet), "byte_order": seen.byte_order}
    if seen.kind == "noise":
        return {"kind": "noise", "bytes": seen.data.hex()}
    kind = "undecodable" if seen.kind == "packet" else seen.kind
    return {"kind": kind, "id": seen.packet_id, "byte_order": seen.byte_order, "bytes": seen.data.hex()}


def _text(passed: Passed) -> str:
    seen = passed.seen
    if passed.packet is not None:
        return lines_for(packet_to_json(passed.packet))[0]
    shown = seen.data[:_SHOWN].hex() + ("..." if len(seen.data) > _SHOWN else "")
    if seen.kind == "noise":
        return f"{len(seen.data)} bytes outside of frames: {shown}"
    if seen.kind == "damaged":
        return f"packet {seen.packet_id} with a wrong checksum: {shown}"
    if seen.kind == "packet":
        return f"packet {seen.packet_id} whose content contradicts itself: {shown}"
    return f"unknown packet {seen.packet_id} ({seen.byte_order}), {len(seen.content)} bytes: {shown}"


def cut(line: str, columns: int) -> str:
    """Return the beginning of a line that fits into so many columns."""
    if text_width(line) <= columns:
        return line
    used, end = 3, 0  # the dots
    for end, character in enumerate(line):  # noqa: B007 - where it ends
        used += text_width(character)
        if used > columns:
            break
    return line[:end] + "..."
