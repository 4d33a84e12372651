"""Figures with bodies for the tests of the twin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import servolink
from servolink.project import Figure
from servolink.twin.body import Body

STUDIO = Path(servolink.__file__).parent / "studio"
DEMO = STUDIO / "demo.servolink.json"
LIMB = {"box": [20, 200, 20], "at": [0, -100, 0]}
"""Limb of 200 mm that hangs from its joint."""


def template(name: str) -> Figure:
    """Return a figure that the studio brings."""
    return Figure.from_json(json.loads((STUDIO / f"web/figures/{name}.figure.json").read_bytes()))


def figure(*joints: dict[str, Any], **more: Any) -> Figure:
    """Return a figure of joints in the form of project files."""
    return Figure.from_json({"figure": 1, "name": "Test", "view": {}, "joints": list(joints), **more})


def body(*joints: dict[str, Any], **more: Any) -> Body:
    """Return the body of a figure."""
    return Body.of(figure(*joints, **more))


def arm(degrees: float = 0, **more: Any) -> Body:
    """Return a bolted limb of 0.4 kg that hangs from servo 1, raised forwards by `degrees` with the servo at 0."""
    limb = {"id": "arm", "servo": 1, "shapes": [LIMB], "mass": 0.4, "axis": "x", "offset": -degrees, **more}
    return body(limb, base={"mode": "fixed", "at": [0, 500, 0]})


def box(**more: Any) -> Body:
    """Return a free box, 40 mm wide and 100 mm high."""
    return body({"id": "box", "shapes": [{"box": [40, 100, 40]}], "mass": 0.5}, body={"bolted": False, **more})


def lamp() -> Figure:
    """Return a lamp that stands free on a base of 100 mm, with servos 1 and 2 in arm and head."""
    base = {"id": "base", "shapes": [{"box": [100, 20, 100]}], "mass": 0.3}
    arm = {"id": "arm", "parent": "base", "servo": 1, "at": [0, 10, 0], "length": 200, "along": [0, 1, 0]}
    head = {"id": "head", "parent": "arm", "servo": 2, "at": [0, 200, 0], "shapes": [{"box": [50, 40, 80]}]}
    return figure(base, arm | {"mass": 0.15}, head | {"mass": 0.1}, body={"bolted": False})
