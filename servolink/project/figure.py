"""Figure: shape of a robot, and the joints turned by servos.

Project files keep the figure for programs with a picture of the robot; no figure is ever sent to a board. Lengths are
in millimetres, angles in degrees; x points to the robot's left, y up, z forward.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType
from msgspec.structs import replace

from servolink.errors import EncodeError, quote
from servolink.protocol import convert

VERSIONS = {"figure": 2, "blocks": 1}
"""Version of the format of each part, raised when an older servolink cannot read files of a newer servolink."""
MOST_JOINTS = 64
COLOURS = ("ra", "rm", "rl", "la", "lm", "ll")
"""Groups of joints, each with a colour: arm (or front), middle, and leg (or rear) of the right and of the left."""

_SHORTEST_AXIS = 1e-9  # one over the length of a shorter axis may be infinite
_SHOWN = 6
"""Joints of a cycle named in an error message."""


def _about(text: str) -> Meta:
    return Meta(description=text)


Place: TypeAlias = Annotated[float, Meta(ge=-5000, le=5000)]
Size: TypeAlias = Annotated[float, Meta(ge=0, le=5000)]
Angle: TypeAlias = Annotated[float, Meta(ge=-360, le=360)]
Vector: TypeAlias = tuple[Place, Place, Place]
Sizes: TypeAlias = tuple[Size, Size, Size]
Servo: TypeAlias = Annotated[int, Meta(ge=0, le=254)]
Name: TypeAlias = Annotated[str, Meta(max_length=64)]
Mass: TypeAlias = Annotated[float, Meta(ge=0.001, le=1000)]
"""Mass of a part or of a robot, in kilograms."""
Torque: TypeAlias = Annotated[float, Meta(ge=0.001, le=1000)]
"""Torque of a servo, in newton metres."""
Speed: TypeAlias = Annotated[float, Meta(ge=1, le=10_000)]
Density: TypeAlias = Annotated[float, Meta(ge=1, le=25_000)]
Friction: TypeAlias = Annotated[float, Meta(ge=0.01, le=10)]
Stiffness: TypeAlias = Annotated[float, Meta(ge=0.0001, le=1000)]
Lag: TypeAlias = Annotated[float, Meta(ge=0.01, le=90)]
"""Angle by which a servo is behind its command, in degrees."""
Axis: TypeAlias = Literal["x", "y", "z"]


class _Part(Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a figure."""


class Shape(_Part, frozen=True):
    """Box with round edges, or a disc; exactly one of both must be given."""

    box: Annotated[Sizes | UnsetType, _about("size along x, y and z, mm")] = UNSET
    disc: Annotated[tuple[Size, Size] | UnsetType, _about("radius and length, mm")] = UNSET
    axis: Annotated[Axis, _about("axis of a disc")] = "x"
    at: Annotated[Vector, _about("middle, in the frame of the joint")] = (0, 0, 0)
    round: Annotated[Size, _about("radius of the edges of a box, mm")] = 6
    tone: Annotated[Literal["shell", "limb", "dark", "glow"], _about("limb: the colour of the group")] = "shell"


class ServoMeasured(_Part, frozen=True):
    """Values of a servo, measured on the robot: each with the lowest and the highest that fit the readings."""

    on: Annotated[str, Meta(pattern=r"^\d{4}-\d{2}-\d{2}$", description="day, such as 2026-11-30")]
    movements: Annotated[int, Meta(ge=1, le=10_000, description="movements that were read")]
    torque: Annotated[tuple[Torque, Torque, Torque] | UnsetType, _about("value, lowest and highest, N m")] = UNSET
    speed: Annotated[tuple[Speed, Speed, Speed] | UnsetType, _about("likewise, degrees/s")] = UNSET
    lag: Annotated[tuple[Lag, Lag, Lag] | UnsetType, _about("likewise, degrees of lag with the full torque")] = UNSET


class Joint(_Part, frozen=True):
    """Part of the robot; the angle to the parent is `sign * degrees of the servo + offset`."""

    id: Name
    parent: Annotated[Name | UnsetType, _about("name of the parent joint")] = UNSET
    servo: Annotated[Servo | UnsetType, _about("servo that turns the joint")] = UNSET
    follows: Annotated[Servo | UnsetType, _about("servo of another joint, to copy the angle")] = UNSET
    group: Annotated[str, _about("name of a group of the figure")] = ""
    at: Annotated[Vector, _about("position in the frame of the parent")] = (0, 0, 0)
    axis: Annotated[Axis | Vector, _about("axis of the rotation")] = "x"
    sign: Annotated[Literal[1, -1], _about("-1: the servo turns the other way")] = 1
    offset: Annotated[Angle, _about("angle of the joint with the servo at 0, degrees")] = 0
    limits: Annotated[tuple[Angle, Angle], _about("lowest and highest angle of the servo, degrees")] = (-180, 180)
    length: Annotated[Size | UnsetType, _about("length of a plain limb without shapes, mm")] = UNSET
    along: Annotated[Vector, _about("direction of a plain limb")] = (0, -1, 0)
    width: Annotated[Size, _about("thickness of a plain limb, mm")] = 26
    tip: Annotated[Vector | UnsetType, _about("point pulled by a drag")] = UNSET
    shapes: Annotated[tuple[Shape, ...], Meta(max_length=64)] | UnsetType = UNSET
    mass: Annotated[Mass | UnsetType, _about("mass of the part, kg; by size if not given")] = UNSET
    torque: Annotated[Torque | UnsetType, _about("strongest torque of the servo, N m; by default of the body")] = UNSET
    speed: Annotated[Speed | UnsetType, _about("fastest turn of the servo, degrees/s; likewise")] = UNSET
    stiffness: Annotated[Stiffness | UnsetType, _about("torque of the servo for each degree of lag, N m; likewise")] = (
        UNSET
    )
    measured: Annotated[ServoMeasured | UnsetType, _about("values of the servo that replace those above")] = UNSET

    def with_measured(self, **fields: Any) -> Joint:
        """Return the joint with the fields of a `ServoMeasured`, in place of what was measured before."""
        return replace(self, measured=ServoMeasured(**fields))


class View(_Part, frozen=True):
    """Viewpoint of a picture of the figure."""

    yaw: Angle = 24
    pitch: Annotated[float, Meta(ge=-90, le=90)] = 9
    distance: Annotated[float, Meta(ge=100, le=5000, description="from the target, mm")] = 1200
    target: Annotated[Vector, _about("middle of the picture")] = (0, 150, 0)
    floor: Annotated[float, Meta(ge=10, le=5000, description="half the width of the floor, mm")] = 420


class FixedBase(_Part, frozen=True, tag_field="mode", tag="fixed"):
    """Base with fixed positions for all joints without a parent."""

    at: Vector = (0, 0, 0)


class Feet(_Part, frozen=True, tag_field="mode", tag="feet"):
    """Base of two feet: the lower foot stays flat on the floor, so that a bow bends the body and not the floor."""

    feet: Annotated[tuple[Name, Name], _about("the joints")]
    sole: Annotated[Vector, _about("middle of a sole, in the frame of the foot")]


class BodyFields(_Part, frozen=True):
    """Physics of the robot for the twin; a value not given follows from the size of the figure."""

    mass: Annotated[Mass | UnsetType, _about("mass of the whole robot, kg")] = UNSET
    density: Annotated[Density | UnsetType, _about("density of parts without a mass, kg/m³")] = UNSET
    torque: Annotated[Torque | UnsetType, _about("strongest torque of a servo, N m")] = UNSET
    speed: Annotated[Speed | UnsetType, _about("fastest turn of a servo, degrees/s")] = UNSET
    stiffness: Annotated[Stiffness | UnsetType, _about("torque of a servo for each degree of lag, N m")] = UNSET
    friction: Annotated[Friction | UnsetType, _about("coefficient of friction, of parts and floor")] = UNSET
    bolted: Annotated[bool | UnsetType, _about("whether the base is bolted down; true without feet")] = UNSET
    touching: Annotated[tuple[tuple[Name, Name], ...], Meta(max_length=256, description="parts that may overlap")] = ()


class Figure(_Part, frozen=True):
    """Shape of a robot, with the joints turned by servos."""

    version: Annotated[Literal[1, 2], _about("version of the format; 2 for a figure with measured servos")] = (
        msgspec.field(name="figure")
    )
    name: Name
    view: View
    joints: Annotated[tuple[Joint, ...], Meta(max_length=MOST_JOINTS)]
    base: FixedBase | Feet = FixedBase()
    groups: Annotated[
        dict[str, Annotated[dict[str, str], Meta(max_length=64)]],
        Meta(max_length=len(COLOURS), description=f"names of the limbs {', '.join(COLOURS)}, by language"),
    ] = msgspec.field(default_factory=dict)
    body: Annotated[BodyFields | UnsetType, _about("masses and servos, for the twin")] = UNSET

    @classmethod
    def from_json(cls, value: Any) -> Figure:
        """Return the figure described by `value`, as by `checked`. Raise EncodeError naming place and reason."""
        refuse_newer(value)
        figure: Figure = convert(value, cls)
        return figure.checked()

    def to_json(self) -> dict[str, Any]:
        """Return the object for the figure, ready for `json.dumps`."""
        form: dict[str, Any] = _form(self)
        return form

    def checked(self) -> Figure:
        """Return the figure with each joint after the parent. Raise EncodeError if impossible to draw."""
        _refuse_wrong_groups(self)
        _refuse_wrong_names(self)
        _refuse_wrong_servos(self)
        for at, joint in enumerate(self.joints):
            _refuse_wrong_shape(f"joints[{at}]", joint)
            _refuse_wrong_ranges(f"joints[{at}].measured", joint.measured)
        version: Literal[1, 2] = 2 if any(joint.measured for joint in self.joints) else 1
        return replace(self, version=version, joints=tuple(_parents_first(self.joints)))


def refuse_newer(value: Any, name: str = "figure") -> None:
    """Raise EncodeError for a figure, or another part of a project `name`, in a future version of the format."""
    version = value.get(name) if isinstance(value, dict) else None
    newest = VERSIONS[name]
    if type(version) is int and version > newest:
        raise EncodeError(f"{version} is newer than {newest}, the newest this servolink reads; update servolink", name)


def _refuse_wrong_groups(figure: Figure) -> None:
    for group in figure.groups:
        if group not in COLOURS:
            raise EncodeError(f"{quote(group)} is not a group; the groups are {', '.join(COLOURS)}", "groups")
    for at, joint in enumerate(figure.joints):
        if joint.group and joint.group not in figure.groups:
            raise EncodeError(f"{quote(joint.group)} is not among the groups of the figure", f"joints[{at}].group")


def _refuse_wrong_names(figure: Figure) -> None:
    if not figure.joints:
        raise EncodeError("a figure needs at least one joint", "joints")
    _refuse_repeated("id", ((at, joint.id) for at, joint in enumerate(figure.joints)))
    joint_ids = {joint.id for joint in figure.joints}
    for at, joint in enumerate(figure.joints):
        if joint.parent is not UNSET and joint.parent not in joint_ids:
            raise EncodeError(f"there is no joint {quote(joint.parent)}", f"joints[{at}].parent")
    if isinstance(figure.base, Feet):
        for number, foot in enumerate(figure.base.feet):
            if foot not in joint_ids:
                raise EncodeError(f"there is no joint {quote(foot)}", f"base.feet[{number}]")
    for number, pair in enumerate(figure.body.touching if figure.body else ()):
        for joint_id in pair:
            if joint_id not in joint_ids:
                raise EncodeError(f"there is no joint {quote(joint_id)}", f"body.touching[{number}]")


def _refuse_wrong_servos(figure: Figure) -> None:
    servos = {at: joint.servo for at, joint in enumerate(figure.joints) if joint.servo is not UNSET}
    _refuse_repeated("servo", servos.items())
    for at, joint in enumerate(figure.joints):
        if joint.follows is UNSET:
            continue
        if joint.servo is not UNSET:
            raise EncodeError("a joint has a servo or follows another servo, not both", f"joints[{at}].follows")
        if joint.follows not in servos.values():
            raise EncodeError(f"no joint has servo {joint.follows}", f"joints[{at}].follows")


def _refuse_repeated(field: str, values: Iterable[tuple[int, object]]) -> None:
    """Raise EncodeError if two joints have the same value in `field`; `values` come with joint numbers."""
    first: dict[object, int] = {}
    for at, value in values:
        if (before := first.setdefault(value, at)) != at:
            raise EncodeError(f"{quote(value)} is also used in joints[{before}]", f"joints[{at}].{field}")


def _refuse_wrong_shape(path: str, joint: Joint) -> None:
    low, high = joint.limits
    if low > high:
        raise EncodeError(f"the lowest angle {low:g} is above the highest, {high:g}", f"{path}.limits")
    if not isinstance(joint.axis, str) and math.hypot(*joint.axis) < _SHORTEST_AXIS:
        found = ", ".join(f"{one:g}" for one in joint.axis)
        raise EncodeError(f"an axis needs a direction, not [{found}]", f"{path}.axis")
    for number, shape in enumerate(joint.shapes or ()):
        if (shape.box is UNSET) == (shape.disc is UNSET):
            raise EncodeError("a shape has either a box or a disc", f"{path}.shapes[{number}]")


def _refuse_wrong_ranges(path: str, measured: ServoMeasured | UnsetType) -> None:
    """Raise EncodeError for a measured value that lies outside its own range."""
    if measured is UNSET:
        return
    for name in ("torque", "speed", "lag"):
        found = getattr(measured, name)
        if found is not UNSET and not found[1] <= found[0] <= found[2]:
            raise EncodeError("a value comes first, then the lowest and the highest around it", f"{path}.{name}")


def _parents_first(joints: tuple[Joint, ...]) -> Iterator[Joint]:
    """Yield each joint after the parent, otherwise in the given order. Raise EncodeError for joints in a circle."""
    by_id = {joint.id: joint for joint in joints}
    done: set[str] = set()
    for at, joint in enumerate(joints):
        waiting: dict[str, Joint] = {}
        node = joint
        while node.id not in done and node.id not in waiting:
            waiting[node.id] = node
            if node.parent is UNSET:
                break
            node = by_id[node.parent]
        else:
            if node.id not in done:
                raise EncodeError(_cycle_text([*waiting][[*waiting].index(node.id) :]), f"joints[{at}].parent")
        done |= waiting.keys()
        yield from reversed(waiting.values())


def _cycle_text(cycle: list[str]) -> str:
    between = ["..."] if len(cycle) > _SHOWN else []
    names = " -> ".join([*map(quote, cycle[:_SHOWN]), *between, quote(cycle[0])])
    return f"a joint cannot hang on itself ({names})"


def _form(value: Any) -> Any:
    """Return `value` without fields at the default, and with whole numbers in the usual notation: 64, not 64.0."""
    if isinstance(value, Struct):
        tag = {value.__struct_config__.tag_field: value.__struct_config__.tag} if isinstance(value, _BASES) else {}
        fields = [(field, getattr(value, field.name)) for field in _fields(type(value))]
        return tag | {field.encode_name: _form(one) for field, one in fields if one not in (field.default, {})}
    if isinstance(value, dict):
        return {key: _form(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return [_form(one) for one in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


_fields = cache(msgspec.structs.fields)
_BASES = (FixedBase, Feet)
