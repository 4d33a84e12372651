"""Position and rotation in space."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, TypeAlias

Vector: TypeAlias = tuple[float, float, float]

UNITS: Final[tuple[Vector, Vector, Vector]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def plus(one: Vector, other: Vector) -> Vector:
    """Return the sum of two vectors."""
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


def times(factor: float, vector: Vector) -> Vector:
    """Return a multiple of a vector."""
    return factor * vector[0], factor * vector[1], factor * vector[2]


def turned(vector: Vector, axis: Vector, angle: float) -> Vector:
    """Return `vector` turned by `angle` (radians) about the unit vector `axis`."""
    (x, y, z), (u, v, w) = vector, axis
    across = (v * z - w * y, w * x - u * z, u * y - v * x)
    along = times((u * x + v * y + w * z) * (1 - math.cos(angle)), axis)
    return plus(plus(times(math.cos(angle), vector), times(math.sin(angle), across)), along)


class Placement(NamedTuple):
    """Frame in space, by its three directions and its origin."""

    x: Vector = UNITS[0]
    y: Vector = UNITS[1]
    z: Vector = UNITS[2]
    at: Vector = (0.0, 0.0, 0.0)

    def direction(self, local: Vector) -> Vector:
        """Return a direction of this frame in space."""
        return plus(plus(times(local[0], self.x), times(local[1], self.y)), times(local[2], self.z))

    def point(self, local: Vector) -> Vector:
        """Return a point of this frame in space."""
        return plus(self.at, self.direction(local))

    def child(self, at: Vector, axis: Vector, angle: float) -> Placement:
        """Return the frame at a point of this frame, turned by `angle` (radians) about `axis`."""
        x, y, z = (self.direction(turned(unit, axis, angle)) for unit in UNITS)
        return Placement(x, y, z, self.point(at))
