"""`servolink board set`: limits for all programs, and facts known to the user of a board.

Limits are kept by servo id: a caption is looked up on the board when they are set. Otherwise nothing is opened.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from msgspec.structs import replace

from servolink.boards import (
    BoardProfile,
    BoardSettings,
    Evidence,
    ProfileFile,
    SafetyLimits,
    setting_from_text,
)
from servolink.cli.arguments import SERVO_NAME, SPEED, number
from servolink.cli.boards.known import NAME, board_known, known_name, label, limit_rows, value_text
from servolink.cli.command import Command, Option, group, option
from servolink.cli.command_session import Interruption, interruptible
from servolink.cli.screen.output import Table, print_error
from servolink.cli.screen.result import Part, Returned
from servolink.cli.usage import usage_error
from servolink.client import IdentityGuard, connect, servo_ids
from servolink.errors import InvalidAddress, RequestTimeout, TransportError, quote

_PAIR = re.compile(r"(-?[0-9.]+)\.\.(-?[0-9.]+)", re.ASCII)
_UNSET = "unset"
_ALL = "all"
_ANGLE = number(-0x8000, 0x7FFF, "degrees")
_COMMON = ("byte_order", "caption_encoding")  # settings whose options every command has


def _angle(text: str) -> tuple[int | str, tuple[float, float] | None]:
    """Return servo and angle limits in degrees, None to unset, from SERVO=LOW..HIGH, for argparse."""
    servo, value = _assigned(text)
    if value == _UNSET:
        return SERVO_NAME(servo), None
    if (pair := _PAIR.fullmatch(value)) is None:
        raise argparse.ArgumentTypeError(f"must have the form 3=20..160, all=-90..90 or 3=unset, not {quote(text)}")
    low, high = _ANGLE(pair[1]), _ANGLE(pair[2])
    if low > high:
        raise argparse.ArgumentTypeError(f"{quote(text)} has the highest angle first; write the lowest first")
    return SERVO_NAME(servo), (low, high)


def _speed(text: str) -> tuple[int | str, float | None]:
    """Return servo and speed cap, None to unset, from SERVO=SPEED, for argparse."""
    servo, value = _assigned(text)
    return SERVO_NAME(servo), None if value == _UNSET else SPEED(value)


def _unsettable(text: str) -> str:
    """Return the name of a setting to unset, for argparse."""
    name = text.replace("-", "_")
    if name not in (*BoardSettings.__struct_fields__, "soft_start"):
        raise argparse.ArgumentTypeError(f"{quote(text)} is not a setting; `servolink board show` lists them")
    return name


def _setting(name: str, help_text: str) -> Option:
    """Return the option of a setting."""

    def read(text: str) -> Any:
        try:
            return setting_from_text(name, text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    metavar = "NAME,..." if name == "unsupported" else "VALUE"
    return option(f"--{name.replace('_', '-')}", metavar, help_text, read)


@Command(
    "board set",
    help="set limits that no program can exceed, and what is known of a board",
    examples=(
        "board set rex --angle 3=20..160 --speed 3=90 --soft-start 60",
        "board set rex --angle all=-90..90 --byte-order big --depth 4",
        "board set rex --angle 3=unset --unset depth",
    ),
    options=(
        *NAME,
        group(
            "limits, which programs can only tighten",
            option(
                "--angle",
                "SERVO=LOW..HIGH",
                "allowed angles in degrees of a servo, such as 3=20..160, or of all=-90..90; 3=unset and all=unset "
                "remove them. A caption in place of an id is looked up on the board, and the id is kept",
                _angle,
                action="append",
                default=[],
            ),
            option(
                "--speed",
                "SERVO=N",
                "most degrees per second of a servo, or of all=N; 3=unset and all=unset remove it",
                _speed,
                action="append",
                default=[],
            ),
            option("--soft-start", "N", "most degrees per second of the first movement from an unknown pose", SPEED),
        ),
        group(
            "settings (and --byte-order, --caption-encoding)",
            *(_setting(name, text) for name, text in BoardSettings.help_in_shell().items() if name not in _COMMON),
            option("--unset", "NAME", "forget a setting, or soft-start", _unsettable, action="append", default=[]),
        ),
    ),
    takes_board=False,
)
@interruptible("nothing was set")
async def run(args: argparse.Namespace, interruption: Interruption) -> Returned:
    """Change and save the profile. Settings of a user have full confidence."""
    name, url = known_name(args)
    given = {key: getattr(args, key) for key in BoardSettings.__struct_fields__ if getattr(args, key) is not None}
    unset = dict.fromkeys(key for key in args.unset if key != "soft_start")
    if not (given or args.unset or args.angle or args.speed or args.soft_start):
        usage_error(args, "give at least one limit or setting")
    if twice := sorted(given.keys() & unset.keys()):
        usage_error(args, f"--{twice[0].replace('_', '-')} is set and unset")
    return _set(args, name, given, unset, await _ids(args, name, url))


async def _ids(args: argparse.Namespace, name: str, url: str | None) -> dict[int | str, int]:
    """Return the id of each servo in `args`. Ask the board only if a caption is given.

    Raise WrongBoard if it is another board than the one of this name: its ids would be others.
    """
    servos = [servo for servo, _ in (*args.angle, *args.speed) if servo != _ALL]
    if all(isinstance(servo, int) for servo in servos):
        return dict(zip(servos, servos, strict=True))
    if url is None:
        raise InvalidAddress(f"{name} has no address, so its captions are unknown; give ids in place of captions")

    try:
        async with connect(
            name, byte_order=args.byte_order, caption_encoding=args.caption_encoding, angle_unit=None
        ) as board:
            if board.profile is not None:
                await IdentityGuard(board.connection, board.profile).refuse_another()
            return dict(zip(servos, await servo_ids(board, servos), strict=True))
    except (TransportError, RequestTimeout) as error:
        raise type(error)(f"{error}; ids in place of captions need no board") from error


def _set(
    args: argparse.Namespace, name: str, given: dict[str, Any], unset: dict[str, Any], ids: Mapping[int | str, int]
) -> Returned:
    """Save the given settings and limits in the profile, without the unset settings."""
    profile = ProfileFile(name).load() or BoardProfile()
    evidence = {key: each for key, each in profile.evidence.items() if key not in unset}
    now = datetime.now(UTC).replace(microsecond=0)
    evidence |= {key: Evidence("certain", Evidence.BY_HAND, now) for key in given}
    changed = replace(
        profile,
        settings=replace(profile.settings, **given, **unset),
        limits=_changed_limits(args, profile.limits, ids),
        evidence=evidence,
    )
    path = ProfileFile(name).save(changed)
    if missing := _missing_servos(changed):
        print_error(f"servolink: {name} was learnt to have no servo {', '.join(map(str, missing))}")
    text: list[Part] = [f"{name} is set; kept in {path}"]
    named = {servo: servo_id for servo, servo_id in ids.items() if isinstance(servo, str)}
    text += [f"'{servo}' is servo {servo_id}; its limits are kept by this id" for servo, servo_id in named.items()]
    rows = [*limit_rows(changed.limits), *((label(key), value_text(key, value)) for key, value in given.items())]
    return Returned(board_known(args).value, [*text, Table((), rows)] if rows else text)


def _missing_servos(profile: BoardProfile) -> list[int]:
    """Return the servos with limits that are missing on the board, if the servos of the board are known."""
    if profile.identity is None or profile.identity.servo_ids is None:
        return []
    return sorted({*profile.limits.angles, *profile.limits.speed_caps} - set(profile.identity.servo_ids))


def _changed_limits(args: argparse.Namespace, limits: SafetyLimits, ids: Mapping[int | str, int]) -> SafetyLimits:
    """Return the limits with all changes of the command line."""
    angles, caps, cap, soft_start = dict(limits.angles), dict(limits.speed_caps), limits.speed_cap, limits.soft_start
    angle_range = limits.angle_range
    for servo, pair in args.angle:
        if servo == _ALL:
            angle_range = pair
        else:
            _put(angles, ids[servo], pair)
    for servo, speed in args.speed:
        if servo == _ALL:
            cap = speed
        else:
            _put(caps, ids[servo], speed)
    if "soft_start" in args.unset:
        soft_start = None
    soft_start = args.soft_start or soft_start
    return replace(
        limits, angle_range=angle_range, angles=angles, speed_cap=cap, speed_caps=caps, soft_start=soft_start
    )


def _put(values: dict[int, Any], servo_id: int, value: Any) -> None:
    if value is None:
        values.pop(servo_id, None)
    else:
        values[servo_id] = value


def _assigned(text: str) -> tuple[str, str]:
    servo, equals, value = text.rpartition("=")  # a caption may contain `=`
    if not equals:
        raise argparse.ArgumentTypeError(f"must be SERVO=VALUE, not {quote(text)}")
    return servo, value
