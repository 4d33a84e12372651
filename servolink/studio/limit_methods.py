"""Limits of servos, measured on a page by hand and kept in the profile of the board."""

from __future__ import annotations

import asyncio
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import replace

from servolink.boards import Aliases, BoardProfile, ProfileFile
from servolink.control import Code, Role, RpcError, Touches
from servolink.studio.studio_methods import METHODS, PageCaller

_turn = asyncio.Lock()
_Degrees = Annotated[float, Meta(ge=-0x8000, le=0x7FFF)]


class AngleLimits(Struct, forbid_unknown_fields=True):
    """Angle limits of a servo in degrees; null for both: no limits."""

    servo: Annotated[int, Meta(ge=0, le=254)]
    low: _Degrees | None
    high: _Degrees | None


class KeptLimits(Struct, frozen=True):
    """Angle limits of all servos in the profile, in degrees by servo id."""

    angles: dict[int, tuple[float, float]]


@METHODS.add("studio.limits.save", Role.EDIT, touches=Touches.HOST, in_order=True, finishes=True)
async def limits_save(caller: PageCaller, params: AngleLimits) -> KeptLimits:
    """Keep the angle limits of a servo in the profile of the board, in force when the board is shared again.

    Refused for a board without a name, as nothing would find the profile; ProfileError if it cannot be written.
    """
    if params.low is not None and params.high is not None and params.low > params.high:
        raise RpcError(Code.INVALID_PARAMS, "the lowest angle is above the highest angle", remedy="exchange the angles")
    async with _turn:  # pages that save together would lose the limits of one of them
        return KeptLimits(await asyncio.to_thread(_save, caller.hub, params))


def _save(name: str, params: AngleLimits) -> dict[int, tuple[float, float]]:
    if name not in Aliases.load() and name not in ProfileFile.names():
        raise RpcError(
            Code.INVALID_REQUEST,
            "limits are kept by the name of a board, and this board has no name",
            remedy="in a terminal: `servolink name NAME ADDRESS`, then `servolink studio --board NAME`",
        )
    profile = ProfileFile(name).load() or BoardProfile()
    angles = {servo: pair for servo, pair in profile.limits.angles.items() if servo != params.servo}
    if params.low is not None and params.high is not None:
        angles[params.servo] = params.low, params.high
    ProfileFile(name).save(replace(profile, limits=replace(profile.limits, angles=angles)))
    return angles
