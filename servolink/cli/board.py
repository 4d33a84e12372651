"""`servolink board`: what is known of each board, and what its user decides. Nothing is opened."""

from __future__ import annotations

import argparse
import asyncio
import re
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from servolink.cli.arguments import SERVO_ID, SPEED, number
from servolink.cli.commands import STORED, Command
from servolink.cli.main import FAILED, OK, fail, usage_error
from servolink.cli.output import Table, print_error, print_json, print_table, print_text
from servolink.cli.parser import Parser
from servolink.cli.session import Interruption, run_interruptible
from servolink.cli.terminal import can_ask, confirm

if TYPE_CHECKING:
    from servolink.profiles.profile import BoardProfile, BoardSettings, SafetyLimits


def _command(place: str, text: str, *examples: str) -> Command:
    return Command(STORED, f"board:{place}", text, tuple(f"board {one}" for one in examples), takes_board=False)


COMMANDS = {
    "list": _command("configure_list", "list the names of boards, and how much is known of each", "list"),
    "show": _command("configure_show", "show what is known of a board, and why", "show rex", "show rex --json"),
    "set": _command(
        "configure_set",
        "set limits that no program can exceed, and what is known of a board",
        "set rex --angle 3=20..160 --speed 3=90 --soft-start 60",
        "set rex --speed all=120 --byte-order big --depth 4",
        "set rex --angle 3=unset --unset depth",
    ),
    "forget": _command("configure_forget", "forget what is known of a board, with its limits", "forget rex --yes"),
}
"""As `servolink.cli.commands.COMMANDS`."""

_PAIR = re.compile(r"(-?[0-9.]+)\.\.(-?[0-9.]+)", re.ASCII)
_UNSET = "unset"
_ANGLE = number(-0x8000, 0x7FFF, "degrees")
_COMMON = ("byte_order", "caption_encoding")  # settings whose options every command has
_SECONDS = ("turnaround", "clear_seconds", "interval_unit")


def configure(parser: Parser) -> None:
    """Add the commands of `servolink board`, which alone lists the boards."""
    parser.set_defaults(run=run_list)
    parser.add_commands(COMMANDS, "board_command", required=False)


# --- list -------------------------------------------------------------------------------------------------------------


def configure_list(parser: argparse.ArgumentParser) -> None:
    """Set what runs; `servolink board list` has no options of its own."""
    parser.set_defaults(run=run_list)


def run_list(args: argparse.Namespace) -> int:
    """Print every board that has a name or a profile."""
    from servolink.discovery.names import load_aliases
    from servolink.errors import ProfileError
    from servolink.profiles.store import load_profile, profile_names

    aliases = load_aliases()
    described: list[dict[str, Any]] = []
    for name in sorted({*aliases, *profile_names()}):
        profile, problem = None, ""
        try:
            profile = load_profile(name)
        except ProfileError as error:
            problem = str(error)
        url = aliases[name].url if name in aliases else None
        described.append({"name": name, "url": url, **_counts(profile), "problem": problem})
    if args.json:
        print_json({"boards": described})
    elif described:
        print_table(Table(("name", "address", "known settings", "limits"), [_row(one) for one in described]))
        for one in described:
            if one["problem"]:
                print_error(f"servolink: {one['problem']}")
    else:
        print_text("no board has a name; `servolink use NAME BOARD` gives one")
    return OK


def _counts(profile: BoardProfile | None) -> dict[str, int | None]:
    if profile is None:
        return {"known_settings": None, "limits": None}
    settings = [value for value in _values(profile.settings).values() if value is not None]
    return {"known_settings": len(settings), "limits": sum(1 for _ in _limit_rows(profile.limits))}


def _row(described: dict[str, Any]) -> tuple[object, ...]:
    damaged = "damaged" if described["problem"] else None
    return described["name"], described["url"], damaged or described["known_settings"], described["limits"]


# --- show -------------------------------------------------------------------------------------------------------------


def configure_show(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink board show`."""
    parser.set_defaults(run=run_show)
    _add_name(parser)


def run_show(args: argparse.Namespace) -> int:
    """Print everything that is known of a board."""
    from msgspec import to_builtins

    from servolink.profiles.profile import BoardProfile
    from servolink.profiles.store import load_profile, profile_path

    name, url = _known_name(args)
    profile = load_profile(name)
    path = str(profile_path(name))
    if args.json:
        shown = to_builtins(profile or BoardProfile())
        evidence = shown.pop("evidence")
        unknown = dict.fromkeys(("confidence", "text", "learnt_at"))
        settings = {
            key: {"value": value, **unknown, **evidence.get(key, {})} for key, value in shown["settings"].items()
        }
        kept = path if profile else None
        print_json({"name": name, "url": url, "path": kept, **shown, "settings": settings})
        return OK
    rows = [("address", url or "none: `servolink use` gives it one"), ("file", path if profile else "none")]
    print_table(Table((), rows + list(_identity_rows(profile or BoardProfile())), title=name))
    for title, part in ("settings", _setting_rows), ("limits", _limit_table):
        print_text("")
        print_table(Table((), list(part(profile or BoardProfile())), title=title))
    if profile is None or None in _values(profile.settings).values():
        print_text("")
        print_text(f"what is unknown can be learnt: servolink doctor {name} --learn")
    return OK


def _identity_rows(profile: BoardProfile) -> Iterator[tuple[str, str]]:
    if (identity := profile.identity) is None:
        yield "identity", "unknown: any board at this address is taken for this one"
        return
    yield from identity.facts()


def _setting_rows(profile: BoardProfile) -> Iterator[tuple[str, str]]:
    for name, value in _values(profile.settings).items():
        evidence = profile.evidence.get(name)
        shown = "unknown" if value is None else _shown(name, value)
        if evidence is not None:
            on = f" ({evidence.learnt_at:%Y-%m-%d})" if evidence.learnt_at else ""
            shown += f"; {evidence.confidence}: {evidence.text}{on}"
        yield name.replace("_", " "), shown


def _shown(name: str, value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    return f"{value} s" if name in _SECONDS else str(value)


def _limit_table(profile: BoardProfile) -> list[tuple[str, str]]:
    return list(_limit_rows(profile.limits)) or [("none", "`servolink board set` sets them")]


def _limit_rows(limits: SafetyLimits) -> Iterator[tuple[str, str]]:
    if limits.speed_cap is not None:
        yield "all servos", f"at most {limits.speed_cap:g} degrees/s"
    if limits.soft_start is not None:
        yield "first movement", f"at most {limits.soft_start:g} degrees/s"
    for servo_id in sorted({*limits.angles, *limits.speed_caps}):
        allowed = []
        if pair := limits.angles.get(servo_id):
            allowed.append(f"{pair[0]:g}..{pair[1]:g} degrees")
        if cap := limits.speed_caps.get(servo_id):
            allowed.append(f"at most {cap:g} degrees/s")
        yield f"servo {servo_id}", ", ".join(allowed)


# --- set and forget ---------------------------------------------------------------------------------------------------


def configure_set(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink board set`: one for each limit and setting."""
    from servolink.profiles.profile import BoardSettings, fields_of

    parser.set_defaults(run=run_set)
    _add_name(parser)
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


def run_set(args: argparse.Namespace) -> int:
    """Change the profile and keep it. What a user sets is certain."""
    from msgspec.structs import replace

    from servolink.profiles.profile import BY_HAND, BoardProfile, BoardSettings, Evidence
    from servolink.profiles.store import load_profile, save_profile

    name, _ = _known_name(args)
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
    rows = [*_limit_rows(changed.limits), *((_label(key), _shown(key, value)) for key, value in given.items())]
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


def configure_forget(parser: argparse.ArgumentParser) -> None:
    """Add the options of `servolink board forget`."""
    parser.set_defaults(run=run_forget)
    _add_name(parser)
    parser.add_argument("--yes", action="store_true", help="do not ask")


def run_forget(args: argparse.Namespace) -> int:
    """Remove the profile, damaged or not, after asking. The name stays."""
    from servolink.profiles.store import profile_names, profile_path, remove_profile

    name = args.name
    if name not in profile_names():
        known = ", ".join(profile_names()) or "none"
        return fail(f"nothing is known of a board {name!r} (profiles: {known}); nothing was changed", FAILED)
    path = profile_path(name)
    question = f"this removes {path} with all limits of {name}"
    if not args.yes and (args.json or not can_ask()):
        usage_error(args, f"{question}; --yes does so without asking")

    async def main(interruption: Interruption) -> int:
        if not args.yes and not await confirm(f"{question}. Forget it?"):
            print_error(f"servolink: {interruption.state}")
            return FAILED
        await asyncio.to_thread(remove_profile, name)
        if args.json:
            print_json({"forgotten": name})
        else:
            print_text(f"what was known of {name} is forgotten; it keeps its name")
        return OK

    return run_interruptible(main, "nothing was changed")


# --- arguments --------------------------------------------------------------------------------------------------------


def _add_name(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", metavar="NAME", help="as given with `servolink use`")


def _known_name(args: argparse.Namespace) -> tuple[str, str | None]:
    """Return name and address of the board in `args`. Raise InvalidAddress if there is no such name."""
    from servolink.discovery.names import load_aliases
    from servolink.errors import InvalidAddress
    from servolink.profiles.store import profile_names

    aliases = load_aliases()
    if args.name not in aliases and args.name not in profile_names():
        known = ", ".join(sorted(aliases)) or "none"
        raise InvalidAddress(f"no board is named {args.name!r} (names: {known}); give it: servolink use NAME BOARD")
    return args.name, aliases[args.name].url if args.name in aliases else None


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


def _label(name: str) -> str:
    return name.replace("_", " ")


def _values(settings: BoardSettings) -> dict[str, Any]:
    from msgspec.structs import asdict

    return asdict(settings)
