"""Body of a robot: parts with masses and servos with torques, from the figure of a project.

Lengths are in metres, masses in kilograms, angles in radians; x points forward, y to the robot's left, z up. Values
missing in the figure follow from the sizes of its parts.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, TypeAlias

from msgspec import UNSET

from servolink.errors import TwinError, quote
from servolink.project import BodyFields, Feet, Figure, Joint, Project, ProjectFile, Shape
from servolink.twin.placement import UNITS, Placement, Vector, plus, times

DENSITY: Final = 600.0
"""Density of parts without a mass, kg/m³: plastic with servos and air."""
GRAVITY: Final = 9.81
"""Gravity of the earth, m/s²."""
TORQUE_SHARE: Final = 0.3
"""Torque of servos without a torque, as a share of the weight of the robot times its size."""
TORQUE_SPARE: Final = 2.0
"""The same, at least as a multiple of the torque to hold the heaviest limb stretched out."""
SPEED: Final = 300.0
"""Fastest turn of servos without a speed, in degrees per second."""
FRICTION: Final = 0.8
"""Coefficient of friction without another: rubber soles on a table."""
MOST_SOLIDS: Final = 512
"""Most shapes of a figure: with more, a moment on the floor may take longer than itself."""
FULL_LAG: Final = 5.0
"""Lag in degrees with the full torque of a servo without a stiffness."""
ROTOR: Final = 0.04
"""Seconds in which a motor without load reaches most of its speed."""

_MILLIMETRE = 1e-3
_THINNEST = 0.5e-3  # half the size of a side that a figure draws without thickness
_LIGHTEST = 1e-6  # kg

Edge: TypeAlias = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Solid:
    """Box or cylinder, fixed to a part."""

    half: Vector
    """Half the size along x, y and z."""
    at: Vector
    """Middle, in the frame of the part."""
    axis: int | None
    """Axis of a cylinder, 0 for x; None for a box."""
    tone: str
    """Tone of the figure, for the colour."""
    mass: float = 0.0

    @property
    def volume(self) -> float:
        """Volume in m³."""
        return 8 * math.prod(self.half) * (1 if self.axis is None else math.pi / 4)


@dataclass(frozen=True, slots=True)
class Drive:
    """Servo: torque in N m, speed in rad/s, stiffness in N m/rad."""

    torque: float
    speed: float
    stiffness: float

    @property
    def damping(self) -> float:
        """Torque lost at each rad/s, N m s: none is left at the full speed."""
        return self.torque / self.speed

    @property
    def armature(self) -> float:
        """Inertia of the motor behind its gears, kg m²."""
        return self.damping * ROTOR

    @property
    def derivative(self) -> float:
        """Torque against each rad/s with which a servo without load does not overshoot, N m s, beside `damping`."""
        return max(0.0, 2 * math.sqrt(self.stiffness * self.armature) - self.damping)


@dataclass(frozen=True, slots=True)
class BodyPart:
    """BodyPart of a body, turned about `axis` by the angle of a servo."""

    name: str
    parent: int | None
    """Index of the parent; None for a part of the base."""
    at: Vector
    """Position in the frame of the parent."""
    axis: Vector
    """Axis of the servo, in its positive direction."""
    offset: float
    """Angle about `axis` with the servo at 0."""
    limits: tuple[float, float]
    servo: int | None
    """Servo that turns the part, or whose angle the part copies; None for a part that never turns."""
    drive: Drive | None
    """None for a part without a servo of its own."""
    solids: tuple[Solid, ...]
    mass: float

    @property
    def rest(self) -> float:
        """Angle of the servo at rest: 0, or the nearest that the limits allow."""
        return min(max(0.0, self.limits[0]), self.limits[1])


@dataclass(frozen=True, slots=True)
class Body:
    """Body of a robot, each part after the parent."""

    name: str
    parts: tuple[BodyPart, ...]
    friction: float
    touching: tuple[Edge, ...]
    """Names of parts that may overlap."""
    bolted: bool
    """Whether the base cannot move."""
    base: Vector
    """Position of the base at rest."""
    feet: tuple[str, ...]
    """Names of the parts that stand flat on the floor; without any, the base of the robot stays upright."""
    has_floor: bool
    assumptions: tuple[str, ...]
    """Values that the figure does not give, as texts for people."""
    basis: dict[str, str]
    """Origin of `weight`, `strength`, `speed` and `lag`: `measured`, `written` in the figure, or `assumed`.

    Of several servos, the worst origin counts.
    """

    @property
    def mass(self) -> float:
        """Mass of all parts, kg."""
        return sum(part.mass for part in self.parts)

    @property
    def drives(self) -> dict[int, tuple[BodyPart, Drive]]:
        """Parts with a servo of their own, by servo id."""
        return {
            part.servo: (part, part.drive) for part in self.parts if part.servo is not None and part.drive is not None
        }

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> tuple[Project, Body]:
        """Return the project in a file, and the body of its figure.

        Raises:
            ProjectError: The file cannot be read.
            TwinError: The file has no figure, or the figure has no possible body.
        """
        project, figure = read_figure(path)
        try:
            return project, cls.of(figure)
        except TwinError as error:
            raise TwinError(f"{os.fspath(path)}: {error}") from error

    @classmethod
    def of(cls, figure: Figure) -> Body:
        """Return the body of a figure as by `Figure.checked`. Raise TwinError for a figure without a possible body."""
        fields = figure.body or BodyFields()
        bolted = not isinstance(figure.base, Feet) if fields.bolted is UNSET else fields.bolted
        indexes = {joint.id: at for at, joint in enumerate(figure.joints)}
        parts = [_part(joint, indexes) for joint in figure.joints]
        if (count := sum(len(part.solids) for part in parts)) > MOST_SOLIDS:
            raise TwinError(
                f"figure.joints: the twin takes at most {MOST_SOLIDS} shapes, and the figure has {count:,}; "
                "join small ones"
            )
        _add_masses(figure, fields, parts)
        _refuse_weightless(parts, bolted=bolted)
        places = _placements_at_rest(parts)
        corners = list(_corners(parts, places))
        lowest = min((corner[2] for corner in corners), default=0.0)
        size = max((max(side) - min(side) for side in zip(*corners, strict=True)), default=0.0)
        weight = sum(part.mass for part in parts)
        weakest = GRAVITY * max(TORQUE_SHARE * size * weight, TORQUE_SPARE * _longest_lever(parts, places))
        parts = [
            replace(part, drive=None if joint.servo is UNSET else _drive(joint, fields, weakest))
            for part, joint in zip(parts, figure.joints, strict=True)
        ]
        at = (0.0, 0.0, -lowest)
        if bolted:
            at = (0.0, 0.0, 0.0) if isinstance(figure.base, Feet) else metres(figure.base.at)
        return cls(
            name=figure.name,
            parts=tuple(parts),
            friction=fields.friction or FRICTION,
            touching=fields.touching,
            bolted=bolted,
            base=at,
            feet=figure.base.feet if isinstance(figure.base, Feet) else (),
            has_floor=at[2] + lowest > -_MILLIMETRE,
            assumptions=tuple(_assumptions(basis := _basis(figure, fields), fields, weight, weakest)),
            basis=basis,
        )

    def posed(self, angles: Mapping[int, float]) -> list[Placement]:
        """Return the frame of each part with servos at `angles` (degrees by id), and all other servos at rest.

        The base is where it is at rest. The lower foot of a robot with feet stays flat, in its place above the floor.
        """
        places, rest = _turned(self, angles), _turned(self, {})
        feet = [at for at, part in enumerate(self.parts) if part.name in self.feet]
        if feet:
            lower = min(feet, key=lambda at: places[at].at[2])
            places = [_seen_from(places[lower], rest[lower], one) for one in places]
        return [one._replace(at=plus(one.at, self.base)) for one in places]


def read_figure(path: str | os.PathLike[str]) -> tuple[Project, Figure]:
    """Return the project in a file, and its figure.

    Raises:
        ProjectError: The file cannot be read.
        TwinError: The file has no figure.
    """
    file = ProjectFile.read(path, unchecked=True)
    if file.figure is None:
        raise TwinError(
            f"{os.fspath(path)}: has no figure, and without one the robot has no body; open the file in "
            "`servolink studio`, fit a figure, and save the file"
        )
    return file.project, file.figure


def _basis(figure: Figure, fields: BodyFields) -> dict[str, str]:
    """Return the origin of weight, strength, speed and lag (see `Body.basis`)."""
    has_weight = fields.mass or fields.density or all(joint.mass for joint in figure.joints)
    basis = {"weight": "written" if has_weight else "assumed"}
    servos = [joint for joint in figure.joints if joint.servo is not UNSET]
    for name, value, written in (("strength", "torque", "torque"), ("speed",) * 3, ("lag", "lag", "stiffness")):
        is_measured = [bool(joint.measured) and bool(getattr(joint.measured, value)) for joint in servos]
        is_written = [getattr(fields, written) or getattr(joint, written) for joint in servos]
        is_known = all(one or other for one, other in zip(is_measured, is_written, strict=True))
        basis[name] = "assumed" if not is_known else "measured" if servos and all(is_measured) else "written"
    return basis


def _assumptions(basis: dict[str, str], fields: BodyFields, weight: float, weakest: float) -> Iterator[str]:
    """Yield each value that the figure does not give for all parts and servos."""
    if basis["weight"] == "assumed":
        yield f"mass of {weight:.3g} kg, by the sizes of the parts"
    if basis["strength"] == "assumed":
        yield f"torque of {weakest:.3g} N m for each servo, by weight and size"
    if basis["speed"] == "assumed":
        yield f"speed of {SPEED:g} degrees/s for each servo"
    if basis["lag"] == "assumed":
        yield f"stiffness of the servos: full torque at a lag of {FULL_LAG:g} degrees"
    if not fields.friction:
        yield f"friction of {FRICTION:g}"


def metres(vector: Vector) -> Vector:
    """Return a place of the figure, in which y points up, in metres and with z up."""
    x, y, z = vector
    return z * _MILLIMETRE, x * _MILLIMETRE, y * _MILLIMETRE


_AXES = {name: metres(unit) for name, unit in zip("xyz", UNITS, strict=True)}


def _part(joint: Joint, indexes: dict[str, int]) -> BodyPart:
    """Return the part of a joint, without masses and drive."""
    axis = _AXES[joint.axis] if isinstance(joint.axis, str) else metres(joint.axis)
    servo = joint.servo if joint.follows is UNSET else joint.follows
    low, high = (math.radians(limit) for limit in joint.limits)
    return BodyPart(
        name=joint.id,
        parent=None if joint.parent is UNSET else indexes[joint.parent],
        at=metres(joint.at),
        axis=times(joint.sign / math.hypot(*axis), axis),
        offset=math.radians(joint.sign * joint.offset),
        limits=(low, high),
        servo=None if servo is UNSET or low == high else servo,
        drive=None,
        solids=tuple(_solid(shape) for shape in _shapes(joint)),
        mass=0.0,
    )


def _shapes(joint: Joint) -> tuple[Shape, ...]:
    """Return the shapes of a joint; as in the studio, a length alone gives a plain limb."""
    if joint.shapes is not UNSET or joint.length is UNSET:
        return joint.shapes or ()
    length, (x, y, z) = joint.length, joint.along
    sides = [abs(share) * length + (1 - abs(share)) * joint.width for share in joint.along]
    size = (max(sides[0], 0.0), max(sides[1], 0.0), max(sides[2], 0.0))
    return (Shape(box=size, at=(x * length / 2, y * length / 2, z * length / 2), tone="limb"),)


def _solid(shape: Shape) -> Solid:
    if shape.box is not UNSET:
        half, axis = times(0.5, metres(shape.box)), None
    else:
        radius, length = shape.disc or (0.0, 0.0)
        sizes = [length if name == shape.axis else 2 * radius for name in "xyz"]
        half, axis = times(0.5, metres((sizes[0], sizes[1], sizes[2]))), "zxy".index(shape.axis)
    thick = (max(half[0], _THINNEST), max(half[1], _THINNEST), max(half[2], _THINNEST))
    return Solid(thick, metres(shape.at), axis, shape.tone)


def _add_masses(figure: Figure, fields: BodyFields, parts: list[BodyPart]) -> None:
    """Give each part a mass: of the joint, or else by volume."""
    if fields.mass is not UNSET and fields.density is not UNSET:
        raise TwinError("figure.body: give the mass of the robot or the density of its parts, not both")
    given = [joint.mass or 0.0 for joint in figure.joints]
    volumes = [sum(solid.volume for solid in part.solids) for part in parts]
    rest = sum(volume for volume, mass in zip(volumes, given, strict=True) if not mass)
    density = fields.density or DENSITY
    if fields.mass is not UNSET:
        left = fields.mass - sum(given)
        if left < 0 or (rest and left <= 0):
            raise TwinError(
                f"figure.body.mass: {fields.mass:g} kg is too little, as single parts weigh {sum(given):g} kg"
            )
        density = left / rest if rest else 0.0
    for at, (part, volume) in enumerate(zip(parts, volumes, strict=True)):
        mass = given[at] or density * volume
        solids = tuple(replace(solid, mass=mass * solid.volume / volume) for solid in part.solids)
        parts[at] = replace(part, mass=mass, solids=solids)


def _refuse_weightless(parts: list[BodyPart], *, bolted: bool) -> None:
    """Raise TwinError if a part that moves has no mass, together with all parts fixed to it."""
    masses: dict[int | None, float] = {}
    holders: list[int | None] = []
    for at, part in enumerate(parts):
        holder = at if part.servo is not None else None if part.parent is None else holders[part.parent]
        holders.append(holder)
        masses[holder] = masses.get(holder, 0.0) + part.mass
    for holder, mass in masses.items():
        if mass < _LIGHTEST and holder is not None:
            what = f"figure.joints: {quote(parts[holder].name)} turns and weighs nothing"
            raise TwinError(f"{what}; give it a mass, a length or shapes")
    if not bolted and masses.get(None, 0.0) < _LIGHTEST:
        raise TwinError(
            "figure.joints: the base stands free and weighs nothing; give a mass or shapes to a part that no servo "
            "turns, or write that the base is bolted"
        )


def _placements_at_rest(parts: list[BodyPart]) -> list[Placement]:
    """Return the frame of each part at rest, with the base at the origin."""
    places: list[Placement] = []
    for part in parts:
        above = Placement() if part.parent is None else places[part.parent]
        places.append(above.child(part.at, part.axis, part.offset + part.rest))
    return places


def _corners(parts: list[BodyPart], places: list[Placement]) -> Iterator[Vector]:
    """Yield the corners of the boxes around all solids."""
    for part, place in zip(parts, places, strict=True):
        for solid in part.solids:
            for x, y, z in product((-1, 1), repeat=3):
                corner = (x * solid.half[0], y * solid.half[1], z * solid.half[2])
                yield place.point(plus(solid.at, corner))


def _longest_lever(parts: list[BodyPart], places: list[Placement]) -> float:
    """Return the highest sum of mass times lever, kg m, over all that one servo carries, as if stretched out."""
    levers = [0.0] * len(parts)
    for part, place in zip(parts, places, strict=True):
        holder: BodyPart | None = part
        while holder is not None:
            at = parts.index(holder)
            if holder.servo is not None:
                for solid in part.solids:
                    levers[at] += solid.mass * math.dist(place.point(solid.at), places[at].at)
            holder = None if holder.parent is None else parts[holder.parent]
    return max(levers, default=0.0)


def _drive(joint: Joint, fields: BodyFields, weakest: float) -> Drive:
    """Return the drive of a joint; `weakest` is the torque of a servo without one."""
    torque = joint.torque or fields.torque or weakest
    speed, lag = joint.speed or fields.speed or SPEED, FULL_LAG
    stiffness = joint.stiffness or fields.stiffness
    if measured := joint.measured:
        torque, speed, lag = (
            found[0] if found else before
            for found, before in ((measured.torque, torque), (measured.speed, speed), (measured.lag, lag))
        )
        stiffness = UNSET if measured.lag else stiffness
    return Drive(torque, math.radians(speed), (stiffness or torque / lag) * 180 / math.pi)


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
