"""Picture of a figure in a pose, drawn without physics and without a screen."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Final, NamedTuple, TypeAlias

from PIL import Image, ImageDraw

from servolink.project import Figure
from servolink.twin import Body, Placement, Solid, Vector, plus, times

SIZE: Final = 640
"""Width and height of a picture, in pixels."""

_MARGIN = 40  # pixels around the figure, on each side
_TURN, _TILT = math.radians(30), math.radians(12)  # of the camera: from the front left, and from above
_LIGHT: Vector = (0.6, 0.3, 0.74)
_SIDES = 12  # of the prism drawn for a cylinder
_TONES = {"shell": (214, 219, 226), "limb": (94, 138, 199), "dark": (70, 76, 86), "glow": (240, 176, 64)}
_BACKGROUND, _INK = (250, 250, 250), (24, 28, 36)

Face: TypeAlias = tuple[Vector, ...]


class _Drawn(NamedTuple):
    """Face on the picture plane, with the distance."""

    depth: float
    points: list[tuple[float, float]]
    colour: tuple[int, ...]


def draw_figure(figure: Figure, angles: Mapping[int, float]) -> bytes:
    """Return a PNG of a figure with servos at `angles` in degrees by id, and all other servos at rest.

    Raise TwinError for a figure without a possible body.
    """
    body = Body.of(figure)
    places = body.posed(angles)
    drawn = [
        _on_plane(face, _TONES[solid.tone])
        for part, place in zip(body.parts, places, strict=True)
        for solid in part.solids
        for face in _faces(solid, place)
    ]
    corners = [point for face in drawn for point in face.points] or [(0.0, 0.0)]
    (left, bottom), (right, top) = (tuple(edge(side) for side in zip(*corners, strict=True)) for edge in (min, max))
    scale = (SIZE - 2 * _MARGIN) / max(right - left, top - bottom, 1e-6)

    def pixel(point: tuple[float, float]) -> tuple[float, float]:
        x, y = point[0] - (left + right) / 2, point[1] - (bottom + top) / 2
        return SIZE / 2 + scale * x, SIZE / 2 - scale * y

    image = Image.new("RGB", (SIZE, SIZE), _BACKGROUND)
    canvas = ImageDraw.Draw(image)
    for face in sorted(drawn):
        canvas.polygon([pixel(point) for point in face.points], fill=face.colour, outline=_INK)
    for part, place in zip(body.parts, places, strict=True):
        if part.drive is not None:
            canvas.text(pixel(_project(place.at)[1:]), str(part.servo), _INK, stroke_width=2, stroke_fill=_BACKGROUND)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def _faces(solid: Solid, place: Placement) -> Iterator[Face]:
    """Yield the faces of a solid in space, counter-clockwise as seen from outside."""
    for face in _box() if solid.axis is None else _prism(solid.axis):
        sized = ((x * solid.half[0], y * solid.half[1], z * solid.half[2]) for x, y, z in face)
        yield tuple(place.point(plus(solid.at, corner)) for corner in sized)


def _box() -> Iterator[Face]:
    """Yield the faces of a box from -1 to 1 on each axis."""
    for axis, side in product(range(3), (-1.0, 1.0)):
        turns = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        yield tuple(_along(axis, side, (side * u, float(v))) for u, v in turns)


def _prism(axis: int) -> Iterator[Face]:
    """Yield the faces of a prism from -1 to 1 about an axis."""
    angles = [2 * math.pi * number / _SIDES for number in range(_SIDES)]
    ring = [(math.cos(angle), math.sin(angle)) for angle in angles]
    yield tuple(_along(axis, 1.0, point) for point in ring)
    yield tuple(_along(axis, -1.0, point) for point in reversed(ring))
    for one, other in zip(ring, [*ring[1:], ring[0]], strict=True):
        yield tuple(_along(axis, side, point) for side, point in ((-1.0, one), (-1.0, other), (1.0, other), (1.0, one)))


def _along(axis: int, height: float, across: tuple[float, float]) -> Vector:
    """Return a point at a height on an axis, and across the axis."""
    x, y, z = (height, *across)
    return ((x, y, z), (z, x, y), (y, z, x))[axis]


def _on_plane(face: Face, tone: tuple[int, int, int]) -> _Drawn:
    """Return a face as seen by the camera, shaded by its direction."""
    seen = [_project(point) for point in face]
    one, other = plus(face[1], times(-1, face[0])), plus(face[2], times(-1, face[1]))
    normal = (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )
    lit = sum(a * b for a, b in zip(normal, _LIGHT, strict=True)) / (math.hypot(*normal) or 1.0)
    colour = tuple(round(value * (0.72 + 0.28 * lit)) for value in tone)
    return _Drawn(sum(point[0] for point in seen) / len(seen), [(x, y) for _, x, y in seen], colour)


def _project(point: Vector) -> Vector:
    """Return nearness to the camera, and the place on the picture plane to the right and up."""
    x, y, z = point
    near, right = x * math.cos(_TURN) + y * math.sin(_TURN), y * math.cos(_TURN) - x * math.sin(_TURN)
    return near * math.cos(_TILT) + z * math.sin(_TILT), right, z * math.cos(_TILT) - near * math.sin(_TILT)
