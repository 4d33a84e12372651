"""Model of a body for MuJoCo, as MJCF text.

A joint of the model has the angle of its servo, in radians: the offset of the figure is in the frame of the part.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from xml.etree import ElementTree as ET

from servolink.errors import escape
from servolink.twin.body import GRAVITY, Body, BodyPart, Drive, Edge, Solid
from servolink.twin.placement import UNITS

FLOOR = "floor"
"""Name of the floor among the bodies that touch."""
BASE = "base"
"""Name of the body that holds all parts."""
TONES = {"shell": "0.86 0.88 0.9 1", "limb": "0.2 0.5 0.85 1", "dark": "0.2 0.22 0.26 1", "glow": "0.3 0.85 1 1"}
"""Colour of each tone of a figure: red, green, blue and opacity."""
POINT = 0.01
"""Radius of gyration in metres of a part with a mass and no shape."""


def model_text(body: Body, step: float = 0.002) -> str:
    """Return the MJCF text of a body, with time steps of `step` seconds."""
    root = ET.Element("mujoco", model=escape(body.name))
    ET.SubElement(root, "compiler", angle="radian", boundinertia="1e-9")
    ET.SubElement(root, "option", timestep=_text(step), integrator="implicitfast", gravity=_texts((0, 0, -GRAVITY)))
    visual = ET.SubElement(root, "visual")
    ET.SubElement(visual, "headlight", ambient="0.5 0.5 0.5", diffuse="0.4 0.4 0.4")
    defaults = ET.SubElement(root, "default")
    ET.SubElement(defaults, "geom", friction=_texts((body.friction, 0.005, 0.0001)))
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "light", pos="0.5 0.5 2", dir="-0.2 -0.2 -1", diffuse="0.4 0.4 0.4")
    if body.has_floor:
        ET.SubElement(world, "geom", name=FLOOR, type="plane", size="2 2 0.1", rgba="0.75 0.78 0.8 1")
    base = ET.SubElement(world, "body", name=BASE, pos=_texts(body.base))
    if not body.bolted:
        ET.SubElement(base, "freejoint", name=BASE)
    names = part_names(body)
    elements: list[ET.Element] = []
    for part, name in zip(body.parts, names, strict=True):
        above = base if part.parent is None else elements[part.parent]
        elements.append(_part(above, part, name))
    _add_contacts(root, body, names)
    _add_actuators(root, body, names)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def part_names(body: Body) -> list[str]:
    """Return the name of each part in the model: readable, different from all others, and safe in XML."""
    used = {"", BASE, FLOOR, "world"}
    names = []
    for at, part in enumerate(body.parts):
        name = escape(part.name)
        while name in used:
            name += f"#{at}"
        used.add(name)
        names.append(name)
    return names


def servo_joint(servo_id: int) -> str:
    """Return the name of the joint and of the actuator of a servo in the model."""
    return f"servo {servo_id}"


def _part(above: ET.Element, part: BodyPart, name: str) -> ET.Element:
    half = part.offset / 2
    turn = (math.cos(half), *(math.sin(half) * one for one in part.axis))
    element = ET.SubElement(above, "body", name=name, pos=_texts(part.at), quat=_texts(turn))
    if part.servo is not None:
        joint = ET.SubElement(element, "joint", name=name, axis=_texts(part.axis))
        if part.drive is not None:
            joint.set("name", servo_joint(part.servo))
            joint.set("damping", _text(part.drive.damping))
            joint.set("armature", _text(part.drive.armature))
            joint.set("limited", "true")
            joint.set("range", _texts(part.limits))
    if part.mass and not part.solids:
        inertia = part.mass * POINT**2
        ET.SubElement(element, "inertial", pos="0 0 0", mass=_text(part.mass), diaginertia=_texts((inertia,) * 3))
    for solid in part.solids:
        _add_solid(element, solid)
    return element


def _add_solid(element: ET.Element, solid: Solid) -> None:
    geom = ET.SubElement(element, "geom", type="box", pos=_texts(solid.at), mass=_text(solid.mass))
    geom.set("rgba", TONES[solid.tone])
    if solid.axis is None:
        geom.set("size", _texts(solid.half))
    else:
        radius = solid.half[solid.axis - 1]
        geom.set("type", "cylinder")
        geom.set("size", _texts((radius, solid.half[solid.axis])))
        geom.set("zaxis", _texts(UNITS[solid.axis]))
    if solid.tone == "glow":  # eyes and lamps
        geom.set("contype", "0")
        geom.set("conaffinity", "0")


def _add_contacts(root: ET.Element, body: Body, names: list[str]) -> None:
    named = {part.name: name for part, name in zip(body.parts, names, strict=True)}
    contact = ET.SubElement(root, "contact")
    for one, other in dict.fromkeys((*body.touching, *(_beside_base(body) if body.bolted else ()))):
        if one != other:
            ET.SubElement(contact, "exclude", body1=named[one], body2=named[other])


def _beside_base(body: Body) -> Iterator[Edge]:
    """Yield the parts on both sides of each joint at a bolted base: MuJoCo excludes all others by itself."""
    holders = list[int | None]()  # by part, the part whose joint turns it; None for the base
    for at, part in enumerate(body.parts):
        holders.append(at if part.servo is not None else None if part.parent is None else holders[part.parent])
    base = [part.name for part, holder in zip(body.parts, holders, strict=True) if holder is None]
    for part, holder in zip(body.parts, holders, strict=True):
        if holder is not None and ((above := body.parts[holder].parent) is None or holders[above] is None):
            yield from ((one, part.name) for one in base)


def _add_actuators(root: ET.Element, body: Body, names: list[str]) -> None:
    equality = ET.SubElement(root, "equality")
    actuator = ET.SubElement(root, "actuator")
    for part, name in zip(body.parts, names, strict=True):
        if part.servo is None:
            continue
        joint = servo_joint(part.servo)
        if part.drive is None:
            ET.SubElement(equality, "joint", joint1=name, joint2=joint)
        else:
            _add_actuator(actuator, joint, part.drive)


def _add_actuator(actuator: ET.Element, joint: str, drive: Drive) -> None:
    servo = ET.SubElement(actuator, "position", name=joint, joint=joint, kp=_text(drive.stiffness))
    servo.set("kv", _text(drive.derivative))
    servo.set("forcelimited", "true")
    servo.set("forcerange", _texts((-drive.torque, drive.torque)))


def _text(number: float) -> str:
    return f"{number:.9g}"


def _texts(numbers: Iterable[float]) -> str:
    return " ".join(map(_text, numbers))
