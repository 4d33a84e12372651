"""Angles, limits, movements and tickets, without a board and without a clock."""

from __future__ import annotations

from servolink.motion.angles import (
    Adc,
    Angle,
    AngleUnit,
    Degrees,
    ServoUnits,
    carries_angles,
    in_unit,
    is_accepted,
    servos_concerned,
    unit_request,
)
from servolink.motion.limits import AngleLimits, MotionLimits, SpeedCap, degrees_per_second, motion_limits
from servolink.motion.movement import (
    INTERVAL_UNIT,
    MotionPlan,
    MotionPlanner,
    Movement,
    Speed,
    check_pace,
    checked_targets,
    idle_servos,
    missing_servo,
)
from servolink.motion.plausibility import doubts
from servolink.motion.set_points import FRESH, ServoWay, SetPoints, checked_set_points
from servolink.motion.ticket import NO_TICKET, STOPPED, StopCounter, Ticket

__all__ = [
    # angles and units
    "Adc",
    "Angle",
    "AngleUnit",
    "Degrees",
    "ServoUnits",
    "carries_angles",
    "in_unit",
    "is_accepted",
    "servos_concerned",
    "unit_request",
    "doubts",
    # limits
    "AngleLimits",
    "MotionLimits",
    "SpeedCap",
    "degrees_per_second",
    "motion_limits",
    # movements
    "FRESH",
    "INTERVAL_UNIT",
    "MotionPlan",
    "MotionPlanner",
    "Movement",
    "ServoWay",
    "SetPoints",
    "Speed",
    "check_pace",
    "checked_set_points",
    "checked_targets",
    "idle_servos",
    "missing_servo",
    # tickets and stops
    "NO_TICKET",
    "STOPPED",
    "StopCounter",
    "Ticket",
]
