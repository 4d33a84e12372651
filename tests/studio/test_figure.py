"""The figure of the page: known poses lead to known points."""

from __future__ import annotations

import math

import pytest

from tests.studio.web_code import call_all, needs_node

_MODULE = "../../../tests/studio/web_figure.js"
_SLANT, _RISE = math.cos(math.radians(35)), math.sin(math.radians(35))
_HALF = 50 * math.sqrt(0.5)

Point = tuple[float, float, float]
PLACES: dict[str, tuple[str, dict[int, int], str, Point, Point]] = {
    "the humanoid stands on its soles": ("humanoid-16", {}, "r_foot", (0, -22, 10), (-29, 0, 10)),
    "and on one, when it lifts a leg": ("humanoid-16", {8: 45, 9: 90, 10: 45}, "l_foot", (0, -22, 10), (29, 0, 10)),
    "and on the straight one, when a knee is bent": ("humanoid-16", {9: 90}, "l_foot", (0, -22, 10), (29, 0, 10)),
    "whichever it is": ("humanoid-16", {14: -20}, "r_foot", (0, -22, 10), (-29, 0, 10)),
    "it raises an arm sideways": ("humanoid-16", {2: 90}, "r_arm", (0, -66, 0), (-150, 316, 0)),
    "the arm points up": ("arm-6", {3: -60, 4: -50}, "roll", (0, 0, 0), (0, 343, 0)),
    "its second jaw follows the first": (
        "arm-6",
        {3: -60, 4: -50, 6: 45},
        "jaw_l",
        (0, 50, 0),
        (20 + _HALF, 369 + _HALF, 0),
    ),
    "the quadruped bends its knees": (
        "quadruped-12",
        {},
        "rf_knee",
        (0, -84, 0),
        (-74, 142 - 164 * _SLANT, 78 + 4 * _RISE),
    ),
    "it stretches a right leg": ("quadruped-12", {2: 35, 3: -70}, "rf_knee", (0, -84, 0), (-74, -22, 78)),
    "and a left one, whose servos turn the other way": (
        "quadruped-12",
        {11: -35, 12: 70},
        "lr_knee",
        (0, -84, 0),
        (74, -22, -78),
    ),
    "the hexapod sets a right leg down": ("hexapod-18", {5: -35, 6: 20}, "rm_shin", (-112, 0, 0), (-184, -44, 0)),
    "and a left one": ("hexapod-18", {14: -35, 15: 20}, "lm_shin", (112, 0, 0), (184, -44, 0)),
    "it turns a front leg to the side": ("hexapod-18", {10: 40}, "lf_thigh", (0, 0, 0), (88, 68, 88)),
}


@needs_node
def test_poses_lead_to_known_points() -> None:
    calls = [(_MODULE, "placeOf", [template, pose, joint, at]) for template, pose, joint, at, _ in PLACES.values()]
    for said, place, expected in zip(PLACES, call_all(calls), PLACES.values(), strict=True):
        assert place == pytest.approx(expected[-1], abs=1e-6), said
