"""`servolink board`: commands that list, show and forget profiles of boards. No board is opened."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from msgspec import Struct
from msgspec.structs import asdict, astuple

from servolink.boards import Aliases, BoardIdentityRecord, BoardNormals, BoardProfile, ProfileFile, SafetyLimits
from servolink.cli.command import STORED, Command, flag, option
from servolink.cli.command_session import Interruption, agreed, interruptible, refuse_unasked
from servolink.cli.screen.output import Table
from servolink.cli.screen.result import CommandResult, Ending, Part, Remark, Returned
from servolink.errors import InvalidAddress, ProfileError, ServolinkError, quote
from servolink.support import ExitCode

_SECONDS = ("turnaround", "clear_seconds", "interval_unit")


class KnownBoard(Struct, frozen=True):
    """Board with a name or a profile; `problem` says what is wrong with a damaged profile."""

    name: str
    url: str | None
    known_settings: int | None
    limits: int | None
    problem: str


class KnownBoards(CommandResult, frozen=True):
    """JSON of `board` and `board list`."""

    boards: list[KnownBoard]


class KnownSetting(Struct, frozen=True):
    """Value of a setting and its evidence; null for an unknown value."""

    value: Any
    confidence: str | None = None
    text: str | None = None
    learnt_at: datetime | None = None


class KnownNormal(Struct, frozen=True):
    """What is normal for a servo: values that nine of ten readings do not exceed, null without readings."""

    moving_current_raw: int | None
    resting_current_raw: int | None
    lag_degrees: int | None
    seconds: float
    learnt_at: datetime
    is_trusted: bool


class BoardKnown(CommandResult, frozen=True):
    """JSON of `board show` and `board set`; `path` is the file of the profile."""

    name: str
    url: str | None
    path: str | None
    identity: BoardIdentityRecord | None
    settings: dict[str, KnownSetting]
    limits: SafetyLimits
    normals: dict[int, KnownNormal]


class BoardForgotten(CommandResult, frozen=True):
    """JSON of `board forget`: the name whose profile was removed."""

    forgotten: str


# --- list -------------------------------------------------------------------------------------------------------------


@Command(
    "board",
    STORED,
    help="show and set the facts known about a board",
    examples=("board", "board show rex"),
    takes_board=False,
)
def run_list(_: argparse.Namespace) -> Returned:
    """Return every board that has a name or a profile."""
    aliases = Aliases.load()
    known: list[KnownBoard] = []
    for name in sorted({*aliases, *ProfileFile.names()}):
        profile, problem = None, ""
        try:
            profile = ProfileFile(name).load()
        except ProfileError as error:
            problem = str(error)
        url = aliases[name].url if name in aliases else None
        known.append(KnownBoard(name, url, *_counts(profile), problem))
    if not known:
        return Returned(KnownBoards(known), "no board has a name; `servolink use NAME BOARD` gives one")
    rows = [(one.name, one.url, "damaged" if one.problem else one.known_settings, one.limits) for one in known]
    table = Table(("name", "address", "known settings", "limits"), rows)
    return Returned(KnownBoards(known), [table, *(Remark(one.problem) for one in known if one.problem)])


BOARD_LIST = run_list.changed(
    name="board list",
    topic="",
    help="list the names of boards, and how much is known of each",
    examples=("board list",),
)


def _counts(profile: BoardProfile | None) -> tuple[int | None, int | None]:
    """Return the number of known settings and of limits."""
    if profile is None:
        return None, None
    settings = [value for value in asdict(profile.settings).values() if value is not None]
    return len(settings), sum(1 for _ in limit_rows(profile.limits))


# --- show -------------------------------------------------------------------------------------------------------------


NAME = (option("name", "NAME", "as given with `servolink use`"),)


def board_known(args: argparse.Namespace) -> Returned:
    """Return everything that is known of a board."""
    name, url = known_name(args)
    profile = ProfileFile(name).load()
    path = str(ProfileFile(name).path) if profile else None
    known = profile or BoardProfile()
    settings = {key: (value, known.evidence.get(key)) for key, value in asdict(known.settings).items()}
    why = {key: KnownSetting(value, *(astuple(why) if why else ())) for key, (value, why) in settings.items()}
    rows = [("address", url or "none: `servolink use` gives it one"), ("file", path or "none")]
    text: list[Part] = [Table((), rows + list(_identity_rows(known)), title=name)]
    for title, part in ("settings", _setting_rows), ("limits", _limit_table):
        text += ["", Table((), list(part(known)), title=title)]
    normals = _normals(name)
    text += ["", Table((), list(_guard_rows(known.limits, normals)), title="guard")]
    if None in asdict(known.settings).values():
        text += ["", f"what is unknown can be learnt: servolink doctor {name} --learn"]
    return Returned(BoardKnown(name, url, path, known.identity, why, known.limits, normals), text)


BOARD_SHOW = Command(
    "board show",
    help="show what is known of a board, and why",
    examples=("board show rex", "board show rex --json"),
    options=(*NAME,),
    takes_board=False,
)(board_known)


def _identity_rows(profile: BoardProfile) -> Iterator[tuple[str, str]]:
    if (identity := profile.identity) is None:
        yield "identity", "unknown: any board at this address is accepted under this name"
        return
    yield from identity.facts()


def _setting_rows(profile: BoardProfile) -> Iterator[tuple[str, str]]:
    """Yield name and text of each setting, with confidence and evidence."""
    for name, value in asdict(profile.settings).items():
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


def _normals(name: str) -> dict[int, KnownNormal]:
    """Return what the guard of a hub has learnt of the servos of a board."""
    kept, now = BoardNormals.load(name), datetime.now(UTC)
    return {
        servo_id: KnownNormal(
            each.most(each.moving),
            each.most(each.resting),
            each.most(each.lags),
            each.seconds,
            each.learnt_at,
            abs(now - each.learnt_at) <= BoardNormals.OLDEST,
        )
        for servo_id, each in sorted(kept.servos.items() if kept else ())
    }


def _guard_rows(limits: SafetyLimits, normals: dict[int, KnownNormal]) -> Iterator[tuple[str, str]]:
    """Yield the settings of the guard, and what is normal for each servo, with its age."""
    guards = {None: "in the studio, and with share --guard", True: "in every hub", False: "in no hub"}
    yield "stops stalls", guards[limits.guard]
    if limits.temperature is not None:
        yield "warns before", f"temperature_raw {limits.temperature}"
    if limits.ease_off:
        yield "eases off", ", ".join(f"servo {servo_id}" for servo_id in limits.ease_off)
    for servo_id, each in normals.items():
        values = {
            "moving": each.moving_current_raw,
            "resting": each.resting_current_raw,
            "degrees behind": each.lag_degrees,
        }
        shown = ", ".join(f"{what} {value}" for what, value in values.items() if value is not None)
        days = (datetime.now(UTC) - each.learnt_at).days
        age = "today" if days < 1 else f"{days} days ago" + ("" if each.is_trusted else ", too old to count")
        yield f"servo {servo_id}", f"normally at most: {shown}; learnt over {each.seconds:.0f} s, {age}"


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
@interruptible("nothing was changed")
async def run_forget(args: argparse.Namespace, interruption: Interruption) -> Ending:
    """Remove the profile, damaged or not, after asking. The name stays."""
    name = args.name
    if name not in ProfileFile.names():
        known = ", ".join(ProfileFile.names()) or "none"
        raise ServolinkError(f"nothing is known of a board {quote(name)} (profiles: {known}); nothing was changed")
    path = ProfileFile(name).path
    question = f"this removes {path} with all limits of {name}"
    refuse_unasked(args, f"{question}; --yes does so without asking")
    if not await agreed(args, interruption, f"{question}. Forget it?"):
        return ExitCode.FAILED
    await asyncio.to_thread(ProfileFile(name).remove)
    BoardNormals.forget(name)
    return Returned(BoardForgotten(name), f"what was known of {name} is forgotten; it keeps its name")


# --- arguments --------------------------------------------------------------------------------------------------------


def known_name(args: argparse.Namespace) -> tuple[str, str | None]:
    """Return name and address of the board in `args`. Raise InvalidAddress if there is no such name."""
    aliases = Aliases.load()
    if args.name not in aliases and args.name not in ProfileFile.names():
        known = ", ".join(sorted(aliases)) or "none"
        raise InvalidAddress(
            f"no board is named {quote(args.name)} (names: {known}); give it: servolink use NAME BOARD"
        )
    return args.name, aliases[args.name].url if args.name in aliases else None


def label(name: str) -> str:
    """Return the name of a setting as people read it."""
    return name.replace("_", " ")
