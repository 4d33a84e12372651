"""Limits of a program as a message, and back: the hub that shares a board keeps to them as well."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

from servolink.control.messages import Tighten
from servolink.escaping import quote
from servolink.motion.limits import MotionLimits

T = TypeVar("T")

_LOWEST, _HIGHEST = -32768.0, 32767.0  # of all angles of the protocol; JSON has no infinity


def limits_in(message: Tighten) -> MotionLimits:
    """Return the limits in a message of a program. Raise ValueError or EncodeError for impossible limits."""
    angles = dict(message.angles)
    pair = angles.pop("all", None)
    by_servo, caps = _by_id('angles, beside "all"', angles), _by_id("speed_caps", message.speed_caps)
    found = MotionLimits(by_servo or None, message.speed_cap, caps, message.soft_start, message.source)
    return found if pair is None else found.tightened(MotionLimits(pair, source=message.source))


def messages_of(limits: MotionLimits) -> list[Tighten]:
    """Return the messages that tell a hub all of the `limits` of a program."""
    return [_message(part) for part in limits.parts() if part]


def _message(limits: MotionLimits) -> Tighten:
    by_servo = limits.angles if isinstance(limits.angles, Mapping) else {}
    angles = {str(servo_id): _finite(pair) for servo_id, pair in by_servo.items()}
    if limits.angles is not None and not isinstance(limits.angles, Mapping):
        angles["all"] = _finite(limits.angles)
    caps = {str(servo_id): cap for servo_id, cap in limits.speed_caps.items() if cap < math.inf}
    return Tighten(angles, limits.speed_cap, caps, limits.soft_start, limits.source)


def _finite(pair: tuple[float, float]) -> tuple[float, float]:
    low, high = (min(max(angle, _LOWEST), _HIGHEST) for angle in pair)
    return low, high


def _by_id(name: str, values: Mapping[str, T]) -> dict[int, T]:
    if wrong := [key for key in values if not (key.isascii() and key.isdecimal())]:
        raise ValueError(f"{name}: {quote(wrong[0])} must be a servo id")
    return {int(key): value for key, value in values.items()}
