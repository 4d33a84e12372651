"""Figure read from a URDF file of another program, which may be hostile: XML without document types, within limits.

Nothing outside the folder of the file is read. Meshes become boxes and discs by their bounds.
"""

from __future__ import annotations

import math
import os
import re
import struct
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple
from xml.etree import ElementTree as ET

from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from servolink.errors import EncodeError, ProjectError, TwinError, quote
from servolink.project import BodyFields, Figure, Joint, Shape, View
from servolink.support import read_file, reason
from servolink.twin.body import Body
from servolink.twin.placement import UNITS, Placement, Vector, plus, times
from servolink.twin.urdf import NEARLY, TONES, ros_names, texts

MOST_BYTES: Final = 2 * 1024 * 1024
"""Most bytes of a URDF file."""
MOST_MESH_BYTES: Final = 16 * 1024 * 1024
"""Most bytes of all meshes of a file together."""
MOST_ELEMENTS: Final = 20_000
MOST_LEVELS: Final = 32
LONGEST_TEXT: Final = 1000
"""Most characters of an attribute."""

_KNOWN = {
    "robot": {"link", "joint", "material"},
    "link": {"visual", "collision", "inertial"},
    "joint": {"origin", "parent", "child", "axis", "limit", "mimic", "servolink"},
}
_FIGURE_AXES: tuple[Literal["x", "y", "z"], ...] = ("z", "x", "y")  # in the order of x, y and z of a URDF
_TURNING = {"revolute", "continuous"}
_LONGEST_NAME = 56  # of 64 characters, with room for a number or "_mount"
_CAPTION = 32  # bytes
_MILLIMETRE, _DEGREE = 1e-3, math.pi / 180
_ALIGNED = 1e-6  # part of a direction across an axis that counts as along the axis
_ROUND = 1.02  # share of the radius within which all points of a disc are
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")


class UrdfFigure(NamedTuple):
    """Figure of a URDF file."""

    figure: Figure
    captions: dict[int, str]
    """Names of the joints turned by servos, by servo id, where they differ from the ids of the figure."""
    warnings: list[str]
    """What the figure does not have of the file, as sentences."""


def read_urdf(path: str | os.PathLike[str]) -> UrdfFigure:
    """Return the figure of a URDF file. Raise ProjectError, within a second, for a file that cannot be one."""
    file = Path(path)
    try:
        root = _parsed(read_file(file, MOST_BYTES))
        return _Reader(root, file.parent.resolve()).read()
    except OSError as error:
        raise ProjectError(f"{file}: cannot be read: {reason(error)}") from error
    except (EncodeError, ValueError) as error:  # ValueError: NUL in the name of the file
        raise ProjectError(f"{file}: {error}") from error


class _Guard(ET.TreeBuilder):
    """Builder of a tree of few elements."""

    def __init__(self) -> None:
        super().__init__()
        self._elements = self._level = 0

    def start(self, tag: str, attrs: dict[Any, Any], /) -> ET.Element:
        self._elements += 1
        self._level += 1
        if self._elements > MOST_ELEMENTS or self._level > MOST_LEVELS:
            raise ProjectError(f"has more than {MOST_ELEMENTS:,} elements, or more than {MOST_LEVELS} in each other")
        if max(map(len, chain(attrs, attrs.values())), default=0) > LONGEST_TEXT:
            raise ProjectError(f"has an attribute of more than {LONGEST_TEXT:,} characters")
        if "xacro" in tag:
            raise ProjectError("has macros of xacro; `xacro FILE > robot.urdf`, a program of ROS, replaces them")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._level -= 1
        return super().end(tag)


def _parsed(content: bytes) -> ET.Element:
    from defusedxml import DTDForbidden, ElementTree  # late: only an import reads XML

    parser = ElementTree.XMLParser(target=_Guard(), forbid_dtd=True)
    try:
        parser.feed(content)
        root: ET.Element = parser.close()
    except DTDForbidden as error:
        raise ProjectError("declares a document type, which can hide files and bombs; delete <!DOCTYPE ...>") from error
    except ProjectError:
        raise
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: encodings
        raise ProjectError(f"is not XML: {error}") from error
    if root.tag != "robot":
        raise ProjectError(f"is not a URDF: the first element must be <robot>, not {quote(root.tag)}")
    return root


class _Reader:
    """Reader of one file; `warnings` grow meanwhile."""

    def __init__(self, root: ET.Element, folder: Path) -> None:
        self._root, self._folder = root, folder
        self._mesh_bytes = MOST_MESH_BYTES
        self._points: dict[Path, list[list[float]]] = {}
        self._warnings: list[str] = []
        self._links, self._joints = _by_name(root, "link"), _by_name(root, "joint")
        self._above: dict[str, ET.Element] = {}
        """Joint that holds each link."""
        for name, joint in self._joints.items():
            for end in ("parent", "child"):
                if _attribute(joint.find(end), "link") not in self._links:
                    raise ProjectError(f"joint {quote(name)}: its {end} is not a link of the file")
            if self._above.setdefault(child := _attribute(joint.find("child"), "link"), joint) is not joint:
                raise ProjectError(f"link {quote(child)} is the child of two joints")
        ids = ros_names((name[:_LONGEST_NAME], f"part_{at}") for at, name in enumerate(self._links))
        self._ids = dict(zip(self._links, ids, strict=True))
        self._servos = self._numbered()

    def read(self) -> UrdfFigure:
        roots = [name for name in self._links if name not in self._above]
        if len(roots) > 1:
            names = ", ".join(map(quote, roots[:4]))
            raise ProjectError(f"has {len(roots):,} links without a parent ({names}), and a robot has one")
        left_out = Counter(one.tag for each in self._root.iter() for one in each if self._is_unknown(each, one))
        if left_out:
            tags = ", ".join(f"{number} {quote(f'<{tag}>')}" for tag, number in left_out.most_common(10))
            self._warnings.append(f"left out, as a figure has nothing like them: {tags}")
        hidden = {name for name in roots if not _KNOWN["link"] & {one.tag for one in self._links[name]}}
        joints = [joint for name in self._links if name not in hidden for joint in self._parts(name, hidden)]
        [name] = ros_names([(_attribute(self._root, "name")[:_LONGEST_NAME], "robot")])
        body = BodyFields(touching=tuple(self._near(hidden)))
        figure = Figure(version=1, name=name, view=View(), joints=tuple(joints), body=body)
        figure = Figure.from_json(figure.to_json())
        captions = {
            servo: joint.encode()[:_CAPTION].decode(errors="ignore")
            for joint, servo in self._servos.items()
            if joint != self._ids[_attribute(self._joints[joint].find("child"), "link")]
        }
        return UrdfFigure(self._seen(figure), captions, self._warnings)

    def _near(self, hidden: set[str]) -> Iterable[tuple[str, str]]:
        """Yield each part with the one that holds it, and with the next one: they overlap at most joints."""
        for link in self._links:
            above = link
            for _ in range(2):
                above = _attribute(self._above[above].find("parent"), "link") if above in self._above else ""
                if above and above not in hidden:
                    yield self._ids[above], self._ids[link]

    def _is_unknown(self, element: ET.Element, child: ET.Element) -> bool:
        return element.tag in _KNOWN and child.tag not in _KNOWN[element.tag]

    def _seen(self, figure: Figure) -> Figure:
        """Return the figure with a view of all of it."""
        try:
            places = [place.at for place in Body.of(figure).posed({})]
        except TwinError as error:
            self._warnings.append(f"the twin cannot have this robot: {error}")
            return figure
        size = 100 + round(1000 * max(max(map(abs, at)) for at in places))
        view = View(distance=min(5000, 3.5 * size), target=(0, min(5000, size / 2), 0), floor=min(5000, size))
        return replace(figure, view=view)

    def _numbered(self) -> dict[str, int]:
        """Return the servo of each joint that a servo turns: as the file says, or the next one that is left."""
        turning = {name: one for name, one in self._joints.items() if one.get("type") in _TURNING}
        servos: dict[str, int] = {}
        for name, joint in turning.items():
            text = _attribute(joint.find("servolink"), "servo")
            if joint.find("mimic") is None and re.fullmatch("[0-9]{1,3}", text, re.ASCII) and int(text) < 255:
                servos[name] = int(text)
        if len(set(servos.values())) < len(servos):
            raise ProjectError("two joints have the same servo")
        others = [name for name, joint in turning.items() if name not in servos and joint.find("mimic") is None]
        if others:
            self._warnings.append("servos are numbered in the order of the joints in the file; see to it that they fit")
        left = (number for number in count(1) if number not in set(servos.values()))
        return servos | dict(zip(others, left, strict=False))

    def _parts(self, link: str, hidden: set[str]) -> Iterable[Joint]:
        """Yield the part of a link, after a part that only turns the frame where the figure needs one."""
        name, element, joint = self._ids[link], self._links[link], self._above.get(link)
        shapes = tuple(shape for one in _shown(element) for shape in self._shapes(link, one))
        mass = _within(_numbers(element.find("inertial/mass"), "value", (0,))[0], 0.001, 1000)
        if element.find("inertial") is not None and mass is UNSET:
            self._warnings.append(f"link {quote(link)}: its mass is not within 1 g and 1 t, and follows from its size")
        part = Joint(name, shapes=shapes or UNSET, mass=mass)
        if joint is None:
            yield part
            return
        parent = _attribute(joint.find("parent"), "link")
        at, (axis, angle) = _origin(joint)
        held: dict[str, Any] = {"parent": UNSET if parent in hidden else self._ids[parent], "at": _lengths(at)}
        turning = self._turning(joint)
        if turning is None:
            yield replace(part, **held, **_turn(axis, angle))
            return
        own, more, fields = turning
        if math.hypot(*_cross(axis, own)) > _ALIGNED and abs(angle) > NEARLY:
            [mount] = ros_names([(f"{name}_mount", "mount")], self._ids.values())
            yield Joint(mount, **held, **_turn(axis, angle))
            held, angle = {"parent": mount}, 0.0
        along = math.copysign(1, sum(a * b for a, b in zip(axis, own, strict=True)))
        yield replace(part, **held, **fields, **_turn(own, along * angle + more))

    def _turning(self, joint: ET.Element) -> tuple[Vector, float, dict[str, Any]] | None:
        """Return axis, further angle and fields of a joint that a servo turns, or None for a joint that is fixed."""
        name, kind = _attribute(joint, "name"), _attribute(joint, "type")
        mimic = joint.find("mimic")
        if kind not in _TURNING:
            if kind != "fixed":
                self._warnings.append(f"joint {quote(name)}: a {quote(kind)} joint is not supported, and is fixed here")
            return None
        axis = _vector(joint.find("axis"), "xyz", (1, 0, 0))
        if mimic is not None:
            return self._following(name, axis, mimic)
        limit = joint.find("limit")
        low, high = (_numbers(limit, field, (end,))[0] for field, end in (("lower", -math.pi), ("upper", math.pi)))
        if kind == "continuous" or limit is None:
            low, high = -math.pi, math.pi
            self._warnings.append(f"joint {quote(name)} has no limits, and gets -180 and 180 degrees")
        most = 2 * math.pi
        fields = {
            "servo": self._servos[name],
            "limits": tuple(_tidy(min(max(end, -most), most), _DEGREE) for end in (low, high)),
            "torque": _within(_numbers(limit, "effort", (0,))[0], 0.001, 1000),
            "speed": _within(_tidy(_numbers(limit, "velocity", (0,))[0], _DEGREE), 1, 10_000),
        }
        return axis, 0.0, fields

    def _following(self, name: str, axis: Vector, mimic: ET.Element) -> tuple[Vector, float, dict[str, Any]] | None:
        """Return what `_turning` does, for a joint that copies another one, or its opposite."""
        leader = self._servos.get(_attribute(mimic, "joint"))
        [factor], [offset] = _numbers(mimic, "multiplier", (1,)), _numbers(mimic, "offset", (0,))
        if leader is None or abs(factor) != 1:
            what = "copies a joint without a servo" if leader is None else f"copies {factor:g} times another joint"
            self._warnings.append(f"joint {quote(name)} {what}, which is not supported, and is fixed here")
            return None
        return times(factor, axis), factor * offset, {"follows": leader}

    def _shapes(self, link: str, element: ET.Element) -> Iterable[Shape]:
        """Yield the box or the disc of a visual element."""
        geometry = element.find("geometry")
        found = None if geometry is None else next(iter(geometry), None)
        at, (axis, angle) = _origin(element)
        turn = Placement().child((0, 0, 0), axis, angle)
        middle, along = (0.0, 0.0, 0.0), None
        more: dict[str, Any] = {}
        match None if found is None else found.tag:
            case "box":
                size = _vector(found, "size", (0, 0, 0))
            case "cylinder":
                [radius], [length] = _numbers(found, "radius", (0,)), _numbers(found, "length", (0,))
                size, along = (2 * radius, 2 * radius, length), 2
            case "sphere":
                [radius] = _numbers(found, "radius", (0,))
                size = times(2 * radius, (1, 1, 1))
                more = {"round": _tidy(radius, _MILLIMETRE)}
            case "mesh":
                try:
                    middle, size, along = _bounds(self._mesh(_attribute(found, "filename")))
                except (OSError, ValueError) as error:
                    text = reason(error) if isinstance(error, OSError) else str(error)
                    name = quote(_attribute(found, "filename"))
                    self._warnings.append(f"link {quote(link)}: mesh {name} is left out: {text}")
                    return
                scale = _vector(found, "scale", (1, 1, 1))
                middle = turn.direction(_product(middle, scale))
                size = _product(size, times(1, (abs(scale[0]), abs(scale[1]), abs(scale[2]))))
            case _:
                self._warnings.append(f"link {quote(link)} has a shape that is not supported and left out")
                return
        rows: list[tuple[float, ...]] = list(zip(turn.x, turn.y, turn.z, strict=True))
        if any(_ALIGNED < abs(entry) < 1 - _ALIGNED for row in rows for entry in row):
            self._warnings.append(f"link {quote(link)}: a tilted shape is replaced by its bounds")
            along = None
        else:
            rows = [tuple(map(round, row)) for row in rows]
        x, y, z = (sum(abs(a) * b for a, b in zip(row, size, strict=True)) for row in rows)
        material = _attribute(element.find("material"), "name")
        more |= {"at": _lengths(plus(at, middle)), "tone": material if material in TONES else "shell"}
        if along is None:
            yield Shape(box=_lengths((x, y, z)), **more)
        else:
            axis_at = max(range(3), key=lambda row: abs(rows[row][along]))
            length = _tidy((x, y, z)[axis_at], _MILLIMETRE)
            radius = _tidy((x, y, z)[axis_at - 1] / 2, _MILLIMETRE)
            yield Shape(disc=(radius, length), axis=_FIGURE_AXES[axis_at], **more)

    def _mesh(self, name: str) -> list[list[float]]:
        """Return x, y and z of all points of a mesh. Raise OSError or ValueError with the reason."""
        scheme, separator, rest = name.rpartition("://")
        if separator and scheme != "package":
            raise ValueError("only files beside the URDF are read")
        tried = [rest, rest.partition("/")[2]] if separator else [name]
        paths = [(self._folder / one).resolve() for one in tried]
        if not all(path.is_relative_to(self._folder) for path in paths):
            raise ValueError("it is outside the folder of the URDF; copy it there")
        path = next((one for one in paths if one.is_file()), paths[0])
        if path not in self._points:
            content = read_file(path, self._mesh_bytes)
            self._mesh_bytes -= len(content)
            self._points[path] = _points(content)
        return self._points[path]


def _by_name(root: ET.Element, tag: str) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = _attribute(element, "name")
        if not name or found.setdefault(name, element) is not element:
            raise ProjectError(f"has a {tag} without a name, or two with the name {quote(name)}")
    return found


def _shown(link: ET.Element) -> list[ET.Element]:
    """Return what a picture of a link shows: visual elements, or those for collisions if it has no others."""
    return link.findall("visual") or link.findall("collision")


def _attribute(element: ET.Element | None, name: str) -> str:
    return "" if element is None else element.get(name, "")


def _numbers(element: ET.Element | None, name: str, default: Sequence[float]) -> list[float]:
    """Return the numbers of an attribute, as many as there are in the default. Raise ProjectError for others."""
    text = None if element is None else element.get(name)
    if element is None or text is None:
        return [*default]
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        found = []
    if len(found) != len(default) or not all(map(math.isfinite, found)):
        needed = "a finite number" if len(default) == 1 else f"{len(default)} finite numbers"
        raise ProjectError(f"<{element.tag}>: {name} must be {needed}, not {quote(text)}")
    return found


def _vector(element: ET.Element | None, name: str, default: Vector) -> Vector:
    x, y, z = _numbers(element, name, default)
    return x, y, z


def _origin(element: ET.Element) -> tuple[Vector, tuple[Vector, float]]:
    """Return the place of a joint or a shape, and its rotation as axis and angle in radians."""
    origin = element.find("origin")
    roll, pitch, yaw = (angle / 2 for angle in _vector(origin, "rpy", (0, 0, 0)))
    (a, b, c), (d, e, f) = map(math.cos, (roll, pitch, yaw)), map(math.sin, (roll, pitch, yaw))
    w, x, y, z = a * b * c + d * e * f, d * b * c - a * e * f, a * e * c + d * b * f, a * b * f - d * e * c
    size = math.hypot(x, y, z)
    axis = times(math.copysign(1 / size, w), (x, y, z)) if size > NEARLY else UNITS[0]
    return _vector(origin, "xyz", (0, 0, 0)), (axis, 2 * math.atan2(size, abs(w)) if size > NEARLY else 0.0)


def _turn(axis: Vector, angle: float) -> dict[str, Any]:
    """Return the fields of a joint for its axis, and for its angle with the servo at 0."""
    x, y, z = axis[1], axis[2], axis[0]
    length = math.hypot(x, y, z)
    for name, along in zip("xyz", (x, y, z), strict=True):
        if length and math.isclose(abs(along), length, rel_tol=NEARLY):
            sign = 1 if along > 0 else -1
            return {"axis": name, "sign": sign, "offset": _tidy(sign * angle, _DEGREE)}
    return {"axis": (x, y, z), "offset": _tidy(angle, _DEGREE)}


def _lengths(vector: Vector) -> Vector:
    """Return a vector of the figure, in millimetres with y up."""
    x, y, z = (_tidy(one, _MILLIMETRE) for one in vector)
    return y, z, x


def _tidy(number: float, unit: float) -> float:
    """Return a number in a unit of the figure; rounded, if an export writes the same text for it then."""
    plain = round(number / unit, 6)
    return plain if texts([plain * unit]) == texts([number]) else number / unit


def _within(number: float, low: float, high: float) -> float | UnsetType:
    return number if low <= number <= high else UNSET


def _product(one: Vector, other: Vector) -> Vector:
    return one[0] * other[0], one[1] * other[1], one[2] * other[2]


def _cross(one: Vector, other: Vector) -> Vector:
    (x, y, z), (u, v, w) = one, other
    return y * w - z * v, z * u - x * w, x * v - y * u


def _points(content: bytes) -> list[list[float]]:
    """Return x, y and z of all points of an STL file, binary or text. Raise ValueError for another file."""
    triangles = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + 50 * triangles:
        columns = [*zip(*struct.iter_unpack("<12x9f2x", content[84:]), strict=True)] or [()] * 9
        points = [[*columns[at], *columns[at + 3], *columns[at + 6]] for at in range(3)]
    else:
        found = _VERTEX.findall(content) if content.lstrip().startswith(b"solid") else []
        points = [[float(point[at]) for point in found] for at in range(3)]
    if not points[0] or not all(math.isfinite(sum(each)) for each in points):
        raise ValueError("it is not an STL file with finite points; save it as STL")
    return points


def _bounds(points: list[list[float]]) -> tuple[Vector, Vector, int | None]:
    """Return middle and size of the bounds of points, and the axis of the disc that they form, if they do."""
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
