"""Figure read from a URDF file of another program, which may be hostile: XML without document types, within limits.

Nothing outside the folder of the file is read. Meshes become boxes and discs by their bounds.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree as ET

from servolink.errors import EncodeError, ProjectError, TwinError, quote
from servolink.project import Figure
from servolink.support import read_file, reason
from servolink.twin.body import Body
from servolink.twin.meshes import Points, bounds, stl_points
from servolink.twin.mjcf import TONES
from servolink.twin.placement import UNITS, Placement, Vector, times
from servolink.twin.urdf import NEARLY, ros_names, texts

MOST_BYTES: Final = 2 * 1024 * 1024
"""Most bytes of a URDF file."""
MOST_MESH_BYTES: Final = 16 * 1024 * 1024
"""Most bytes of all meshes of a file together."""
MOST_ELEMENTS: Final = 20_000
MOST_LEVELS: Final = 32
MOST_LINKS: Final = 65
"""Most links of a figure of 64 parts, with a root link that is only a frame."""
LONGEST_TEXT: Final = 1000
"""Most characters of an attribute."""

_KNOWN = {
    "robot": {"link", "joint", "material"},
    "link": {"visual", "collision", "inertial"},
    "joint": {"origin", "parent", "child", "axis", "limit", "mimic", "servolink"},
}
_TURNING = {"revolute", "continuous"}
_LONGEST_NAME = 56  # of 64 characters, with room for a number or "_mount"
_MOST_TOUCHING = 256  # pairs of a figure
_CAPTION = 32  # bytes
_MILLIMETRE, _DEGREE = 1e-3, math.pi / 180
_PARALLEL = 1 - 1e-12  # cosine between two axes that count as one
_ALIGNED = 2e-3  # how far a direction may be from an axis: many files have 1.57 for a right angle


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
        return _UrdfReader(root, file.parent.resolve()).read()
    except OSError as error:
        raise ProjectError(f"{file}: cannot be read: {reason(error)}") from error
    except (EncodeError, ValueError) as error:  # ValueError: NUL in the name of the file
        raise ProjectError(f"{file}: {error}") from error


class _SmallTree(ET.TreeBuilder):
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

    parser = ElementTree.XMLParser(target=_SmallTree(), forbid_dtd=True)
    try:
        parser.feed(content)
        root: ET.Element = parser.close()
    except DTDForbidden as error:
        raise ProjectError("declares a document type, which can hide files and bombs; delete <!DOCTYPE ...>") from error
    except ProjectError:  # of the builder
        raise
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: encodings
        raise ProjectError(f"is not XML: {error}") from error
    if root.tag != "robot":
        raise ProjectError(f"is not a URDF: the first element must be <robot>, not {quote(root.tag)}")
    return root


class _UrdfReader:
    """Reader of one file; `warnings` grow meanwhile."""

    def __init__(self, root: ET.Element, folder: Path) -> None:
        self._root, self._folder = root, folder
        self._mesh_bytes = MOST_MESH_BYTES
        self._points: dict[Path, Points] = {}
        self._warnings: list[str] = []
        self._links, self._joints = _by_name(root, "link"), _by_name(root, "joint")
        if len(self._links) > MOST_LINKS:
            raise ProjectError(f"has {len(self._links):,} links, and a figure takes at most {MOST_LINKS}")
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
        elements = (self._root, *self._links.values(), *self._joints.values())
        left_out = Counter(one.tag for each in elements for one in each if one.tag not in _KNOWN[each.tag])
        for tag, number in left_out.most_common(20):
            self._warnings.append(f"left out, as a figure has nothing like it: {number} {quote(f'<{tag}>')}")
        if roots and not _KNOWN["link"] & {one.tag for one in self._links[roots[0]]}:
            del self._ids[roots[0]]  # only a frame, as the root link of an export
        joints = [joint for name in self._ids for joint in self._parts(name)]
        [name] = ros_names([(_attribute(self._root, "name")[:_LONGEST_NAME], "robot")])
        form = {"figure": 1, "name": name, "view": {}, "joints": joints}
        captions = {
            servo: joint.encode()[:_CAPTION].decode(errors="ignore")
            for joint, servo in self._servos.items()
            if joint != self._ids[_attribute(self._joints[joint].find("child"), "link")]
        }
        return UrdfFigure(self._seen(form), captions, self._warnings)

    def _seen(self, form: dict[str, Any]) -> Figure:
        """Return the figure with a view of all of it; parts next to each other may overlap, as in most robots."""
        figure = Figure.from_json(form)  # refuses a circle of links, in which `_rigid` would not end
        rigid, touching = {link: self._rigid(link) for link in self._ids}, []
        for link, first in rigid.items():
            above = first
            for _ in range(2):
                if above in self._above:
                    above = self._rigid(self._parent(above))
                    touching += [[self._ids[one], self._ids[link]] for one in rigid if rigid[one] == above]
        form |= {"body": {"touching": touching[:_MOST_TOUCHING]}}
        try:
            size = 100 + round(1000 * max(max(map(abs, place.at)) for place in Body.of(figure).posed({})))
            far, floor = min(5000, 3.5 * size), min(5000, size)
            form |= {"view": {"distance": far, "target": [0, floor / 2, 0], "floor": floor}}
        except TwinError as error:
            self._warnings.append(f"the twin cannot have this robot: {error}")
        return Figure.from_json(form)

    def _way(self, link: str) -> list[int]:
        """Return the places in the file of the links from the root to a link."""
        order, way = [*self._links], [link]
        while way[-1] in self._above and len(way) < MOST_LINKS:  # a circle is refused later
            way.append(self._parent(way[-1]))
        return [order.index(one) for one in reversed(way)]

    def _parent(self, link: str) -> str:
        return _attribute(self._above[link].find("parent"), "link")

    def _rigid(self, link: str) -> str:
        """Return the first of the links that are fixed to each other and to this one."""
        while link in self._above and self._above[link].get("type") not in _TURNING:
            link = self._parent(link)
        return link

    def _numbered(self) -> dict[str, int]:
        """Return the servo of each joint that a servo turns: as the file says, or the next one, limb by limb."""
        servos: dict[str, int | None] = {}
        for link in sorted(self._above, key=self._way):
            joint = self._above[link]
            name = _attribute(joint, "name")
            if joint.get("type") in _TURNING and joint.find("mimic") is None:
                text = _attribute(joint.find("servolink"), "servo")
                servos[name] = int(text) if re.fullmatch("[0-9]{1,3}", text, re.ASCII) else None
        given = [servo for servo in servos.values() if servo is not None]
        if len(set(given)) < len(given):
            raise ProjectError("two joints have the same servo")
        if len(given) < len(servos):
            self._warnings.append("servos are numbered limb by limb, from the root; see to it that they fit the robot")
        left = (number for number in count(1) if number not in given)
        return {name: next(left) if servo is None else servo for name, servo in servos.items()}

    def _parts(self, link: str) -> Iterable[dict[str, Any]]:
        """Yield the part of a link, after a part that only turns the frame where the figure needs one."""
        element, joint = self._links[link], self._above.get(link)
        shown = element.findall("visual") or element.findall("collision")
        shapes = [shape for one in shown for shape in self._shape(link, one)]
        part: dict[str, Any] = {"id": self._ids[link], "shapes": shapes}
        if element.find("inertial") is not None:
            part |= _within("mass", _number(element.find("inertial/mass"), "value"), 0.001, 1000)
            if "mass" not in part:
                self._warnings.append(f"link {quote(link)}: a mass outside 1 g to 1 t; it follows from the size here")
        if joint is None:
            yield part
            return
        parent = self._parent(link)
        at, axis, angle = _origin(joint)
        held: dict[str, Any] = {"parent": self._ids[parent]} if parent in self._ids else {}
        held |= {"at": _lengths(at)}
        turning = self._turning(joint)
        if turning is None:
            yield part | held | _turn(axis, angle)
            return
        own, more, fields = turning
        along = sum(a * b for a, b in zip(axis, own, strict=True)) / (math.hypot(*own) or 1)
        if abs(along) < _PARALLEL and angle > NEARLY:
            [mount] = ros_names([(f"{part['id']}_mount", "mount")], self._ids.values())
            yield {"id": mount} | held | _turn(axis, angle)
            held, angle = {"parent": mount}, 0.0
        yield part | held | fields | _turn(own, math.copysign(angle, along) + more)

    def _turning(self, joint: ET.Element) -> tuple[Vector, float, dict[str, Any]] | None:
        """Return axis, further angle and fields of a joint that a servo turns, or None for a joint that is fixed."""
        name, kind = _attribute(joint, "name"), _attribute(joint, "type")
        mimic, limit = joint.find("mimic"), joint.find("limit")
        if kind not in _TURNING:
            if kind != "fixed":
                self._warnings.append(f"joint {quote(name)}: a {quote(kind)} joint is not supported, and is fixed here")
            return None
        axis = _vector(joint.find("axis"), "xyz", UNITS[0])
        if mimic is not None:
            leader, factor = self._servos.get(_attribute(mimic, "joint")), _number(mimic, "multiplier", 1)
            if leader is not None and abs(factor) == 1:
                return times(factor, axis), factor * _number(mimic, "offset"), {"follows": leader}
            what = "a joint without a servo" if leader is None else f"{factor:g} times another joint"
            self._warnings.append(f"joint {quote(name)} copies {what}, which is not supported, and is fixed here")
            return None
        low, high = (_number(limit, field, end) for field, end in (("lower", -math.pi), ("upper", math.pi)))
        if kind == "continuous" or limit is None:
            low, high = -math.pi, math.pi
            self._warnings.append(f"joint {quote(name)} has no limits, and gets -180 and 180 degrees")
        limits = [_tidy(min(max(end, -2 * math.pi), 2 * math.pi), _DEGREE) for end in (low, high)]
        fields = _within("torque", _number(limit, "effort"), 0.001, 1000)
        fields |= _within("speed", _tidy(_number(limit, "velocity"), _DEGREE), 1, 10_000)
        return axis, 0.0, fields | {"servo": self._servos[name], "limits": limits}

    def _shape(self, link: str, element: ET.Element) -> Iterable[dict[str, Any]]:
        """Yield the box or the disc for a visual element, if it has one."""
        geometry = element.find("geometry/*")
        try:
            middle, size, along = self._bounds(geometry)
        except ProjectError:
            raise
        except (OSError, ValueError) as error:
            name = _attribute(geometry, "filename")
            self._warnings.append(f"link {quote(link)}: shape {quote(name)} is left out: {reason(error)}")
            return
        at, axis, angle = _origin(element)
        turn = Placement(at=at).child((0, 0, 0), axis, angle)
        rows: list[tuple[float, ...]] = list(zip(turn.x, turn.y, turn.z, strict=True))
        if any(_ALIGNED < abs(entry) < 1 - _ALIGNED for row in rows for entry in row):
            self._warnings.append(f"link {quote(link)}: a tilted shape is replaced by its bounds")
            along = None
        else:
            rows = [tuple(map(round, row)) for row in rows]
        x, y, z = (sum(abs(a) * b for a, b in zip(row, size, strict=True)) for row in rows)
        material = _attribute(element.find("material"), "name")
        shape = {"at": _lengths(turn.point(middle)), "tone": material if material in TONES else "shell"}
        if along is None:
            yield shape | {"box": _lengths((x, y, z))}
        else:
            row = next(at for at in range(3) if rows[at][along])
            radius, length = _tidy((x, y, z)[row - 1] / 2, _MILLIMETRE), _tidy((x, y, z)[row], _MILLIMETRE)
            yield shape | {"disc": (radius, length), "axis": "zxy"[row]}

    def _bounds(self, geometry: ET.Element | None) -> tuple[Vector, Vector, int | None]:
        """Return middle and size of a geometry, and the axis of a disc. Raise OSError or ValueError if unreadable."""
        tag, middle = "nothing" if geometry is None else geometry.tag, (0.0, 0.0, 0.0)
        radius = _number(geometry, "radius")
        if tag == "box":
            return middle, _vector(geometry, "size", middle), None
        if tag == "cylinder":
            return middle, (2 * radius, 2 * radius, _number(geometry, "length")), 2
        if tag == "sphere":
            return middle, times(2 * radius, (1, 1, 1)), None
        if tag != "mesh":
            raise ValueError(f"a figure has nothing like {quote(f'<{tag}>')}")
        return bounds(self._mesh(_attribute(geometry, "filename")), _vector(geometry, "scale", (1, 1, 1)))

    def _mesh(self, name: str) -> Points:
        """Return the points of a mesh. Raise OSError or ValueError with the reason."""
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
            self._points[path] = stl_points(content)
        return self._points[path]


def _by_name(root: ET.Element, tag: str) -> dict[str, ET.Element]:
    found: dict[str, ET.Element] = {}
    for element in root.findall(tag):
        name = _attribute(element, "name")
        if not name or found.setdefault(name, element) is not element:
            raise ProjectError(f"has a {tag} without a name, or two with the name {quote(name)}")
    return found


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


def _number(element: ET.Element | None, name: str, default: float = 0.0) -> float:
    return _numbers(element, name, (default,))[0]


def _vector(element: ET.Element | None, name: str, default: Vector) -> Vector:
    x, y, z = _numbers(element, name, default)
    return x, y, z


def _origin(element: ET.Element) -> tuple[Vector, Vector, float]:
    """Return the place of a joint or a shape, and its rotation as axis and angle in radians."""
    origin = element.find("origin")
    roll, pitch, yaw = (angle / 2 for angle in _vector(origin, "rpy", (0, 0, 0)))
    (a, b, c), (d, e, f) = map(math.cos, (roll, pitch, yaw)), map(math.sin, (roll, pitch, yaw))
    w, x, y, z = a * b * c + d * e * f, d * b * c - a * e * f, a * e * c + d * b * f, a * b * f - d * e * c
    sine, at = math.hypot(x, y, z), _vector(origin, "xyz", (0, 0, 0))
    if sine < NEARLY:
        return at, UNITS[0], 0.0
    return at, times(math.copysign(1 / sine, w), (x, y, z)), 2 * math.atan2(sine, abs(w))


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


def _within(field: str, number: float, low: float, high: float) -> dict[str, Any]:
    """Return a field of a joint; without it, if the number is outside the range."""
    return {field: number} if low <= number <= high else {}
