"""`servolink board`: commands that list, show and forget profiles of boards. No board is opened."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from servolink.cli.command import STORED, Command, flag, option
from servolink.cli.command_session import Interruption, agreed, refuse_unasked, run_interruptible
from servolink.cli.screen.output import Table, print_error, print_json, print_result, print_table, print_text
from servolink.errors import ServolinkError
from servolink.escaping import quote
from servolink.script import FAILED, OK

if TYPE_CHECKING:
    from servolink.profiles.profile import BoardProfile, BoardSettings, SafetyLimits


_SECONDS = ("turnaround", "clear_seconds", "interval_unit")


# --- list -------------------------------------------------------------------------------------------------------------


@Command(
    "board",
    STORED,
    help="show and set the facts known about a board",
    examples=("board", "board show rex"),
    takes_board=False,
)
def run_list(args: argparse.Namespace) -> int:
    """Print every board that has a name or a profile."""
    from servolink.discovery.names import load_aliases
    from servolink.errors import ProfileError
    from servolink.profiles.listing import profile_names
    from servolink.profiles.store import load_profile

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


BOARD_LIST = run_list.changed(
    name="board list",
    topic="",
    help="list the names of boards, and how much is known of each",
    examples=("board list",),
)


def _counts(profile: BoardProfile | None) -> dict[str, int | None]:
    if profile is None:
        return {"known_settings": None, "limits": None}
    settings = [value for value in _values(profile.settings).values() if value is not None]
    return {"known_settings": len(settings), "limits": sum(1 for _ in limit_rows(profile.limits))}


def _row(described: dict[str, Any]) -> tuple[object, ...]:
    damaged = "damaged" if described["problem"] else None
    return described["name"], described["url"], damaged or described["known_settings"], described["limits"]


# --- show -------------------------------------------------------------------------------------------------------------


NAME = (option("name", "NAME", "as given with `servolink use`"),)


def print_board(args: argparse.Namespace) -> int:
    """Print everything that is known of a board."""
    from msgspec import to_builtins

    from servolink.profiles.profile import BoardProfile
    from servolink.profiles.store import load_profile, profile_path

    name, url = known_name(args)
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


BOARD_SHOW = Command(
    "board show",
    help="show what is known of a board, and why",
    examples=("board show rex", "board show rex --json"),
    options=(*NAME,),
    takes_board=False,
)(print_board)


def _identity_rows(profile: BoardProfile) -> Iterator[tuple[str, str]]:
    if (identity := profile.identity) is None:
        yield "identity", "unknown: any board at this address is accepted under this name"
        return
    yield from identity.facts()


def _setting_rows(profile: BoardProfile) -> Iterator[tuple[str, str]]:
    """Yield name and text of each setting, with confidence and evidence."""
    for name, value in _values(profile.settings).items():
        evidence = profile.evidence.get(name)
        shown = "unknown" if value is None else value_text(name, value)
        if evidence is not None:
            on = f" ({evidence.learnt_at:%Y-%m-%d})" if evidence.learnt_at else ""
            shown += f"; {evidence.confidence}: {evidence.text}{on}"
        yield label(name), shown


def value_text(name: str, value: object) -> str:
    """Return the value of a setting as people read it."""
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    return f"{value} s" if name in _SECONDS else str(value)


def _limit_table(profile: BoardProfile) -> list[tuple[str, str]]:
    """Return the rows of all limits, or a hint for a profile without limits."""
    return list(limit_rows(profile.limits)) or [("none", "`servolink board set` sets them")]


def limit_rows(limits: SafetyLimits) -> Iterator[tuple[str, str]]:
    """Yield servo and value of each limit."""
    if limits.angle_range is not None or limits.speed_cap is not None:
        yield "all servos", _limits_text(limits.angle_range, limits.speed_cap)
    if limits.soft_start is not None:
        yield "first movement", f"at most {limits.soft_start:g} degrees/s"
    for servo_id in sorted({*limits.angles, *limits.speed_caps}):
        yield f"servo {servo_id}", _limits_text(limits.angles.get(servo_id), limits.speed_caps.get(servo_id))


def _limits_text(pair: tuple[float, float] | None, cap: float | None) -> str:
    angles = [] if pair is None else [f"{pair[0]:g}..{pair[1]:g} degrees"]
    return ", ".join(angles + ([] if cap is None else [f"at most {cap:g} degrees/s"]))


# --- forget -----------------------------------------------------------------------------------------------------------


@Command(
    "board forget",
    help="forget what is known of a board, with its limits",
    examples=("board forget rex --yes",),
    options=(*NAME, flag("--yes", "do not ask")),
    takes_board=False,
)
def run_forget(args: argparse.Namespace) -> int:
    """Remove the profile, damaged or not, after asking. The name stays."""
    from servolink.profiles.listing import profile_names
    from servolink.profiles.store import profile_path, remove_profile

    name = args.name
    if name not in profile_names():
        known = ", ".join(profile_names()) or "none"
        raise ServolinkError(f"nothing is known of a board {quote(name)} (profiles: {known}); nothing was changed")
    path = profile_path(name)
    question = f"this removes {path} with all limits of {name}"
    refuse_unasked(args, f"{question}; --yes does so without asking")

    async def main(interruption: Interruption) -> int:
        if not await agreed(args, interruption, f"{question}. Forget it?"):
            return FAILED
        await asyncio.to_thread(remove_profile, name)
        print_result(args, {"forgotten": name}, f"what was known of {name} is forgotten; it keeps its name")
        return OK

    return run_interruptible(main, "nothing was changed")


# --- arguments --------------------------------------------------------------------------------------------------------


def known_name(args: argparse.Namespace) -> tuple[str, str | None]:
    """Return name and address of the board in `args`. Raise InvalidAddress if there is no such name."""
    from servolink.discovery.names import load_aliases
    from servolink.errors import InvalidAddress
    from servolink.profiles.listing import profile_names

    aliases = load_aliases()
    if args.name not in aliases and args.name not in profile_names():
        known = ", ".join(sorted(aliases)) or "none"
        raise InvalidAddress(
            f"no board is named {quote(args.name)} (names: {known}); give it: servolink use NAME BOARD"
        )
    return args.name, aliases[args.name].url if args.name in aliases else None


def label(name: str) -> str:
    """Return the name of a setting as people read it."""
    return name.replace("_", " ")


def _values(settings: BoardSettings) -> dict[str, Any]:
    from msgspec.structs import asdict

    return asdict(settings)
