"""Points and bounds of meshes in STL files, whose content may be anything."""

from __future__ import annotations

import math
import re
import struct
from typing import TypeAlias

from servolink.twin.placement import Vector

Points: TypeAlias = list[list[float]]
"""All x, all y and all z of some points."""

_ROUND = 1.02  # share of the radius within which all points of a disc are
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


def stl_points(content: bytes) -> Points:
    """Return x, y and z of all points of an STL file, binary or text. Raise ValueError for another file."""
    triangles = int.from_bytes(content[80:84], "little")
    points: Points = []
    try:
        if triangles and len(content) == 84 + 50 * triangles:
            columns = list(zip(*struct.iter_unpack("<12x9f2x", content[84:]), strict=True))
            points = [[*columns[at], *columns[at + 3], *columns[at + 6]] for at in range(3)]
        elif content.lstrip().startswith(b"solid"):
            points = [[float(number) for number in each] for each in zip(*_VERTEX.findall(content), strict=True)]
    except ValueError:  # from the text of a number
        points = []
    if not points or not all(math.isfinite(sum(each)) for each in points):
        raise ValueError("it is not an STL file with finite points; save it as STL")
    return points


def bounds(points: Points, scale: Vector) -> tuple[Vector, Vector, int | None]:
    """Return middle and size of the bounds of scaled points, and the axis of the disc that they form, if they do."""
    points = [[factor * number for number in each] for factor, each in zip(scale, points, strict=True)]
    ends = [(min(each), max(each)) for each in points]
    (x, u), (y, v), (z, w) = ends
    middle, size = ((x + u) / 2, (y + v) / 2, (z + w) / 2), (u - x, v - y, w - z)
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        radius = max(size[one], size[other]) / 2
        if min(size[one], size[other]) * _ROUND >= 2 * radius > 0:
            pairs = zip(points[one], points[other], strict=True)
            if max(math.hypot(a - middle[one], b - middle[other]) for a, b in pairs) <= radius * _ROUND:
                return middle, size, axis
    return middle, size, None
