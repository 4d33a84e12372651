"""QR codes, for the cameras of tablets."""

from __future__ import annotations

from itertools import groupby

import segno
from msgspec import Struct

_MARGIN = 4
"""Modules of white around a code, without which cameras do not find it."""


class QrCode(Struct, frozen=True):
    """A code as a picture."""

    size: int
    """Width and height, with the margin, in modules."""
    path: str
    """What is black, as the `d` of a path in SVG."""


def qr_code(text: str) -> QrCode:
    """Return the code that cameras read as `text`."""
    code = segno.make_qr(text, error="m")
    runs: list[str] = []
    for y, row in enumerate(code.matrix, _MARGIN):
        x = _MARGIN
        for is_black, modules in groupby(row):
            width = len(list(modules))
            if is_black:
                runs.append(f"M{x} {y}h{width}v1h-{width}z")
            x += width
    return QrCode(len(code.matrix) + 2 * _MARGIN, "".join(runs))
