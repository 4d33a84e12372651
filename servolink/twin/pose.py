"""Pose of a body without physics: the frame of each part, for pictures and transforms."""

from __future__ import annotations

import math
from collections.abc import Mapping

from servolink.twin.body import Body
from servolink.twin.placement import Placement, Vector, plus, times


def posed(body: Body, angles: Mapping[int, float]) -> list[Placement]:
    """Return the frame of each part with servos at `angles` (degrees by id), and all other servos at rest.

    The base is where it is at rest. The lower foot of a robot with feet stays flat, in its place above the floor.
    """
    places, rest = _turned(body, angles), _turned(body, {})
    feet = [at for at, part in enumerate(body.parts) if part.name in body.feet]
    if feet:
        lower = min(feet, key=lambda at: places[at].at[2])
        places = [_seen_from(places[lower], rest[lower], one) for one in places]
    return [one._replace(at=plus(one.at, body.base)) for one in places]


def _turned(body: Body, angles: Mapping[int, float]) -> list[Placement]:
    """Return the frame of each part, with the base at the origin."""
    places: list[Placement] = []
    for part in body.parts:
        above = Placement() if part.parent is None else places[part.parent]
        degrees = None if part.servo is None else angles.get(part.servo)
        angle = part.rest if degrees is None else math.radians(degrees)
        places.append(above.child(part.at, part.axis, part.offset + angle))
    return places


def _seen_from(foot: Placement, flat: Placement, one: Placement) -> Placement:
    """Return a frame after a turn of the whole robot that brings the frame `foot` to `flat`."""

    def stood(vector: Vector) -> Vector:
        x, y, z = (sum(a * b for a, b in zip(axis, vector, strict=True)) for axis in (foot.x, foot.y, foot.z))
        return flat.direction((x, y, z))

    at = plus(flat.at, stood(plus(one.at, times(-1, foot.at))))
    return Placement(stood(one.x), stood(one.y), stood(one.z), at)
