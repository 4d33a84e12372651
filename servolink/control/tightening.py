"""Limits of a program as a message, and back: the hub that shares a board keeps to them as well."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, TypeVar

from msgspec import Meta, Struct

from servolink.control.status import about
from servolink.errors import quote
from servolink.motion import MotionLimits

T = TypeVar("T")

_LOWEST, _HIGHEST = -32768.0, 32767.0  # of all angles of the protocol; JSON has no infinity
_MOST_SERVOS = 255


class Tighten(Struct, forbid_unknown_fields=True):
    """Limits in addition to those of the board."""

    angles: Annotated[
        dict[str, tuple[float, float]],
        Meta(max_length=_MOST_SERVOS + 1, description='lowest and highest angle in degrees, by servo id or "all"'),
    ] = {}
    speed_cap: Annotated[float | None, about("highest speed in degrees per second; null for no further cap")] = None
    speed_caps: Annotated[
        dict[str, float], Meta(max_length=_MOST_SERVOS, description="the same for single servos, by id")
    ] = {}
    soft_start: Annotated[float | None, about("highest speed of a servo's first movement; null for any")] = None
    source: Annotated[str, Meta(max_length=200, description="source named in errors")] = ""

    @classmethod
    def messages(cls, limits: MotionLimits) -> list[Tighten]:
        """Return the messages that tell a hub all of the `limits` of a program."""
        return [cls._of(part) for part in limits.parts() if part]

    @classmethod
    def _of(cls, limits: MotionLimits) -> Tighten:
        by_servo = limits.angles if isinstance(limits.angles, Mapping) else {}
        angles = {str(servo_id): _finite(pair) for servo_id, pair in by_servo.items()}
        if limits.angles is not None and not isinstance(limits.angles, Mapping):
            angles["all"] = _finite(limits.angles)
        caps = {str(servo_id): cap for servo_id, cap in limits.speed_caps.items() if cap < math.inf}
        return cls(angles, limits.speed_cap, caps, limits.soft_start, limits.source)

    def limits(self) -> MotionLimits:
        """Return the limits in the message. Raise ValueError or EncodeError for impossible limits."""
        angles = dict(self.angles)
        pair = angles.pop("all", None)
        by_servo, caps = _by_id('angles, beside "all"', angles), _by_id("speed_caps", self.speed_caps)
        found = MotionLimits(by_servo or None, self.speed_cap, caps, self.soft_start, self.source)
        return found if pair is None else found.tightened(MotionLimits(pair, source=self.source))


def _finite(pair: tuple[float, float]) -> tuple[float, float]:
    low, high = (min(max(angle, _LOWEST), _HIGHEST) for angle in pair)
    return low, high


def _by_id(name: str, values: Mapping[str, T]) -> dict[int, T]:
    if wrong := [key for key in values if not (key.isascii() and key.isdecimal())]:
        raise ValueError(f"{name}: {quote(wrong[0])} must be a servo id")
    return {int(key): value for key, value in values.items()}
