"""`servolink board set`: limits that no program can exceed, and what a user knows of a board. Nothing is opened."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from servolink.cli.arguments import SERVO_ID, SPEED, number
from servolink.cli.board import add_name, known_name, label, limit_rows, run_show, value_text
from servolink.cli.main import OK, usage_error
from servolink.cli.output import Table, print_error, print_table, print_text

if TYPE_CHECKING:
    from servolink.profiles.profile import BoardProfile, SafetyLimits

_PAIR = re.compile(r"(-?[0-9.]+)\.\.(-?[0-9.]+)", re.ASCII)
_UNSET = "unset"
_ANGLE = number(-0x8000, 0x7FFF, "degrees")
_COMMON = ("byte_order", "caption_encoding")  # settings whose options every command has


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink board set`: one for each limit and setting."""
    from servolink.profiles.profile import BoardSettings, fields_of

    parser.set_defaults(run=run)
    add_name(parser)
    limits = parser.add_argument_group("limits, which programs can only tighten")
    limits.add_argument(
        "--angle",
        action="append",
        default=[],
        type=_angle,
        metavar="SERVO=LOW..HIGH",
        help="allowed angles of a servo in degrees, such as 3=20..160; 3=unset removes them",
    )
    limits.add_argument(
        "--speed",
        action="append",
        default=[],
        type=_speed,
        metavar="SERVO=N",
        help="most degrees per second of a servo, or of all=N; 3=unset and all=unset remove it",
    )
    limits.add_argument(
        "--soft-start",
        type=SPEED,
        metavar="N",
        help="most degrees per second of the first movement from an unknown pose",
    )
    settings = parser.add_argument_group("settings (and --byte-order, --caption-encoding)")
    for name, (_, about) in fields_of(BoardSettings).items():
        if name not in _COMMON:
            option = f"--{name.replace('_', '-')}"
            help_text = f"{about.meaning} ({about.wanted})"
            settings.add_argument(option, type=_setting(name), metavar="VALUE", help=help_text)
    settings.add_argument(
        "--unset", action="append", default=[], type=_unsettable, metavar="NAME", help="forget a setting, or soft-start"
    )


def run(args: argparse.Namespace) -> int:
    """Change the profile and keep it. What a user sets is certain."""
    from msgspec.structs import replace

    from servolink.profiles.profile import BY_HAND, BoardProfile, BoardSettings, Evidence
    from servolink.profiles.store import load_profile, save_profile

    name, _ = known_name(args)
    profile = load_profile(name) or BoardProfile()
    given = {key: getattr(args, key) for key in BoardSettings.__struct_fields__ if getattr(args, key) is not None}
    unset = dict.fromkeys(key for key in args.unset if key != "soft_start")
    if not (given or args.unset or args.angle or args.speed or args.soft_start):
        usage_error(args, "give at least one limit or setting")
    if twice := sorted(given.keys() & unset.keys()):
        usage_error(args, f"--{twice[0].replace('_', '-')} is set and unset")
    evidence = {key: each for key, each in profile.evidence.items() if key not in unset}
    now = datetime.now(UTC).replace(microsecond=0)
    evidence |= {key: Evidence("certain", BY_HAND, now) for key in given}
    changed = replace(
        profile,
        settings=replace(profile.settings, **given, **unset),
        limits=_changed_limits(args, profile.limits),
        evidence=evidence,
    )
    path = save_profile(name, changed)
    if missing := _missing_servos(changed):
        print_error(f"servolink: {name} was learnt to have no servo {', '.join(map(str, missing))}")
    if args.json:
        return run_show(args)
    print_text(f"{name} is set; kept in {path}")
    rows = [*limit_rows(changed.limits), *((label(key), value_text(key, value)) for key, value in given.items())]
    if rows:
        print_table(Table((), rows))
    return OK


def _missing_servos(profile: BoardProfile) -> list[int]:
    """Return the servos that have limits and are not on the board, if its servos are known."""
    if profile.identity is None or profile.identity.servo_ids is None:
        return []
    return sorted({*profile.limits.angles, *profile.limits.speed_caps} - set(profile.identity.servo_ids))


def _changed_limits(args: argparse.Namespace, limits: SafetyLimits) -> SafetyLimits:
    from servolink.profiles.profile import SafetyLimits

    angles, caps, cap, soft_start = dict(limits.angles), dict(limits.speed_caps), limits.speed_cap, limits.soft_start
    for servo_id, pair in args.angle:
        _put(angles, servo_id, pair)
    for servo_id, speed in args.speed:
        if servo_id is None:
            cap = speed
        else:
            _put(caps, servo_id, speed)
    if "soft_start" in args.unset:
        soft_start = None
    return SafetyLimits(angles=angles, speed_cap=cap, speed_caps=caps, soft_start=args.soft_start or soft_start)


def _put(values: dict[int, Any], servo_id: int, value: Any) -> None:
    if value is None:
        values.pop(servo_id, None)
    else:
        values[servo_id] = value


def _angle(text: str) -> tuple[int, tuple[float, float] | None]:
    servo_id, value = _assigned(text)
    if value == _UNSET:
        return SERVO_ID(servo_id), None
    if (pair := _PAIR.fullmatch(value)) is None:
        raise argparse.ArgumentTypeError(f"must be like 3=20..160 or 3=unset, not {text!r}")
    low, high = _ANGLE(pair[1]), _ANGLE(pair[2])
    if low > high:
        raise argparse.ArgumentTypeError(f"{text!r} has the highest angle first; write the lowest first")
    return SERVO_ID(servo_id), (low, high)


def _speed(text: str) -> tuple[int | None, float | None]:
    servo_id, value = _assigned(text)
    return None if servo_id == "all" else SERVO_ID(servo_id), None if value == _UNSET else SPEED(value)


def _assigned(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"must be SERVO=VALUE, not {text!r}")
    return name, value


def _setting(name: str) -> Callable[[str], Any]:
    """Return a type for the values of a setting."""
    from servolink.profiles.store import setting_from_text

    def read(text: str) -> Any:
        try:
            return setting_from_text(name, text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


def _unsettable(text: str) -> str:
    from servolink.profiles.profile import BoardSettings

    name = text.replace("-", "_")
    if name not in (*BoardSettings.__struct_fields__, "soft_start"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a setting; `servolink board show` lists them")
    return name
