"""URDF text of a figure, for ROS and other programs that read robots in this format.

Frames and angles are those of the model for MuJoCo: a joint of the robot has the angle of its servo, in radians, and
the root link is on the floor below the robot.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from itertools import count
from typing import Final
from xml.etree import ElementTree as ET

from servolink.project import Feet, Figure
from servolink.twin.body import Body, BodyPart, metres
from servolink.twin.mjcf import POINT, TONES
from servolink.twin.placement import UNITS, Vector, plus, times, turned

ROOT: Final = "base_link"
"""Name of the root link, unless a part of the figure has it."""
NEARLY: Final = 1e-9
"""Difference below which two directions, or the length of an axis and 1, count as equal."""

_TURNS = ("0 0 0", f"{-math.pi / 2:.12g} 0 0", f"0 {math.pi / 2:.12g} 0")
"""Rotations of a cylinder, whose axis is z in URDF, to z, y and x."""
_RESERVED = ("world",)  # programs take a link of this name for the world
_KEPT = 28  # characters of a name that gets a number: a caption has room for 32


def to_urdf(figure: Figure, captions: Mapping[int, str] | None = None) -> str:
    """Return the URDF text of a figure as by `Figure.checked`.

    The joint of a servo has the caption of the servo as its name, or else the id of the joint in the figure, both as
    by `ros_names`: captions by servo id that are valid and different are the names of the joints, unchanged. Joints
    that copy the angle of a servo mimic its joint.

    Raises:
        TwinError: The figure has no possible body.
    """
    body = Body.of(figure)
    links = ros_names(((part.name, f"part_{at}") for at, part in enumerate(body.parts)), _RESERVED)
    names = _joint_names(body, links, captions or {})
    root = ET.Element("robot", name=ros_names([(body.name, "robot")])[0])
    for tone, colour in TONES.items():
        ET.SubElement(ET.SubElement(root, "material", name=tone), "color", rgba=colour)
    [base] = ros_names([(ROOT, ROOT)], links)
    ET.SubElement(root, "link", name=base)
    axes = [_axis(joint.axis, joint.sign) for joint in figure.joints]
    driven = zip(body.parts, names, strict=True)
    leaders = {part.servo: (name, part, part.drive) for part, name in driven if part.drive and part.servo is not None}
    base_at = body.base if isinstance(figure.base, Feet) else metres(figure.base.at)
    for part, link, name, axis in zip(body.parts, links, names, axes, strict=True):
        _add_link(root, link, part)
        turned_by = None if part.servo is None else leaders.get(part.servo)
        joint = ET.SubElement(root, "joint", name=name, type="revolute" if turned_by else "fixed")
        at = plus(base_at, part.at) if part.parent is None else part.at
        ET.SubElement(joint, "origin", xyz=texts(at), rpy=texts(_rpy(axis, part.offset)))
        ET.SubElement(joint, "parent", link=base if part.parent is None else links[part.parent])
        ET.SubElement(joint, "child", link=link)
        if turned_by is None:
            continue
        leader, holder, drive = turned_by
        ET.SubElement(joint, "axis", xyz=texts(axis))
        limit = ET.SubElement(joint, "limit", lower=texts(holder.limits[:1]), upper=texts(holder.limits[1:]))
        limit.attrib |= {"effort": texts([drive.torque]), "velocity": texts([drive.speed])}
        if holder is part:
            ET.SubElement(joint, "servolink", servo=str(part.servo))
        else:
            ET.SubElement(joint, "mimic", joint=leader, multiplier="1", offset="0")
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def ros_names(wanted: Iterable[tuple[str, str]], taken: Iterable[str] = ()) -> list[str]:
    """Return a name for each pair of a text and a name without it: all different, none of `taken`, and valid in ROS.

    A name has letters, digits and underscores, and does not begin with a digit. Texts that are so stay unchanged.
    """
    pairs = list(wanted)
    used, names = set(taken), dict[int, str]()
    clean = [_clean(text) or other for text, other in pairs]
    for at in sorted(range(len(pairs)), key=lambda at: clean[at] != pairs[at][0]):  # the valid texts come first
        name = clean[at]
        if name in used:
            name = next(one for number in count(2) if (one := f"{name[:_KEPT]}_{number}") not in used)
        used.add(name)
        names[at] = name
    return [names[at] for at in range(len(pairs))]


def texts(numbers: Iterable[float]) -> str:
    """Return numbers as the text of an attribute, with 12 digits."""
    return " ".join(f"{round(number, 12) + 0.0:.12g}" for number in numbers)  # + 0.0: no "-0"


def _clean(text: str) -> str:
    """Return a text with an underscore for what no name may have; empty if no letter and no digit is left."""
    name = re.sub(r"[^A-Za-z0-9_]+", "_", text)
    name = name if name == text else name.strip("_")
    return "" if not name.strip("_") else f"_{name}" if name[0].isdigit() else name


def _joint_names(body: Body, links: list[str], captions: Mapping[int, str]) -> list[str]:
    """Return the name of the joint of each part: those of servos first, as other joints must not take their names."""
    servos = {at: part.servo for at, part in enumerate(body.parts) if part.servo is not None and part.drive}
    wanted = [(captions.get(servo) or links[at], links[at]) for at, servo in servos.items()]
    named = dict(zip(servos, ros_names(wanted), strict=True))
    others = [at for at in range(len(links)) if at not in named]
    named |= zip(others, ros_names([(links[at], links[at]) for at in others], named.values()), strict=True)
    return [named[at] for at in range(len(links))]


def _axis(axis: str | Vector, sign: int) -> Vector:
    """Return the axis of a joint. An axis that is nearly of length 1 is not changed: reading it gives the same text."""
    x, y, z = UNITS["xyz".index(axis)] if isinstance(axis, str) else axis
    length = math.hypot(x, y, z)
    return times(sign / (1 if abs(length - 1) < NEARLY else length), (z, x, y))  # as by `metres`


def _rpy(axis: Vector, angle: float) -> Vector:
    """Return roll, pitch and yaw of a turn about an axis, in radians."""
    angle = math.pi - (math.pi - angle) % (2 * math.pi)  # above -pi, at most pi
    if max(map(abs, axis)) > 1 - NEARLY:
        return times(angle, axis)
    x, y, z = (turned(unit, axis, angle) for unit in UNITS)
    flat = math.hypot(x[0], x[1])
    if flat < NEARLY:  # roll and yaw are about the same axis
        return math.atan2(-z[1], y[1]), math.atan2(-x[2], flat), 0.0
    return math.atan2(y[2], z[2]), math.atan2(-x[2], flat), math.atan2(x[1], x[0])


def _add_link(root: ET.Element, name: str, part: BodyPart) -> None:
    link = ET.SubElement(root, "link", name=name)
    if part.mass:
        _add_inertial(link, part)
    for solid in part.solids:
        for use in ("visual",) if solid.tone == "glow" else ("visual", "collision"):  # glow: eyes and lamps
            element = ET.SubElement(link, use)
            turn = _TURNS[0 if solid.axis is None else 2 - solid.axis]
            ET.SubElement(element, "origin", xyz=texts(solid.at), rpy=turn)
            shape = ET.SubElement(element, "geometry")
            if solid.axis is None:
                ET.SubElement(shape, "box", size=texts(times(2, solid.half)))
            else:
                radius, length = solid.half[solid.axis - 1], 2 * solid.half[solid.axis]
                ET.SubElement(shape, "cylinder", radius=texts([radius]), length=texts([length]))
            if use == "visual":
                ET.SubElement(element, "material", name=solid.tone)


def _add_inertial(link: ET.Element, part: BodyPart) -> None:
    """Add mass, centre of mass, and inertia about it, computed from the mass as written."""
    mass = float(texts([part.mass]))
    volume = sum(solid.volume for solid in part.solids)
    masses = [(mass * solid.volume / volume, solid) for solid in part.solids]
    x, y, z = (sum(share / mass * solid.at[at] for share, solid in masses) for at in range(3))
    matrix = [[0.0] * 3 for _ in UNITS]
    for share, solid in masses:
        away = plus(solid.at, (-x, -y, -z))
        spread = [half**2 / (3 if solid.axis in {None, at} else 4) for at, half in enumerate(solid.half)]  # m² of a kg
        for at in range(3):
            matrix[at][at] += share * (sum(spread) - spread[at] + math.hypot(*away) ** 2)
            for other in range(3):
                matrix[at][other] -= share * away[at] * away[other]
    if not masses:
        matrix = [[mass * POINT**2 * (at == other) for other in range(3)] for at in range(3)]
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=texts((x, y, z)), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=texts([mass]))
    inertia = ET.SubElement(inertial, "inertia")
    unit = 10 ** (math.floor(math.log10(max(matrix[at][at] for at in range(3)))) - 7)  # hides what sums leave of zeros
    for at, other in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        inertia.set(f"i{'xyz'[at]}{'xyz'[other]}", f"{round(matrix[at][other] / unit) * unit:.8g}")
